//! Describes a stream before its first frame: meshes, instances, settings.

use std::sync::Arc;

use psao_codec::Layout;
use psao_codec::block::BlockCoder;
use psao_codec::surface::{Encoder, EncoderSettings, Geometry, GeometrySource, RestPoint, SetLayout};
use psao_proto::message::{MemberEntry, Needs, PointSource, SetEntry};
use psao_proto::session::Access;
use psao_proto::{Limits, SceneEntries, SceneInfo, SceneTable, TraceInfo};

use super::{PublishError, Publisher};

/// Number of a mesh in a stream, as [`PublisherBuilder::mesh`] returned it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MeshId(pub u32);

/// Number of an instance in a stream, as [`PublisherBuilder::instance`] returned it. Clients know the instance by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InstanceId(pub u32);

/// Lattice steps to a kernel radius.
const STEPS_PER_KERNEL: f32 = 20.0;
/// Bits of one axis of a normal's octahedral code.
const NORMAL_BITS: u8 = 6;

/// Describes a stream; [`build`](Self::build) makes its [`Publisher`].
///
/// A stream needs a name, meshes with points, and instances of them. All else has a default.
#[derive(Clone, Debug)]
pub struct PublisherBuilder {
    name: String,
    digest: [u8; 32],
    fps: f32,
    threshold: u8,
    coder: BlockCoder,
    trace: Option<TraceInfo>,
    access: Access,
    limits: Limits,
    meshes: Vec<Mesh>,
    instances: Vec<MeshId>,
}

/// The points of a mesh, rounded and ordered.
#[derive(Clone, Debug)]
struct Mesh {
    geometry: Arc<Geometry>,
    /// Number in the stream's order of each point in the caller's order.
    numbers: Arc<[u32]>,
}

impl PublisherBuilder {
    pub(super) fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            digest: [0; 32],
            fps: 60.0,
            threshold: 8,
            coder: BlockCoder::Range,
            trace: None,
            access: Access::Open,
            limits: Limits::default(),
            meshes: Vec::new(),
            instances: Vec::new(),
        }
    }

    /// Adds the points of a mesh at rest and returns its number. Instances of the mesh share them.
    ///
    /// Points of one chart are blended with each other, those of different charts are not: see [`Charts`](crate::Charts).
    /// `kernel_radius` is the distance in metres within which a point adds to the AO of a place. About 1.5 times the
    /// distance between neighbouring points is a good choice. Positions are rounded to a twentieth of it, or less finely on
    /// a mesh of more than 100,000 kernel radii.
    pub fn mesh(&mut self, points: &[RestPoint], kernel_radius: f32) -> MeshId {
        let step = kernel_radius / STEPS_PER_KERNEL;
        let lattice = SetLayout::covering(points, step, NORMAL_BITS, kernel_radius);
        let rounded = Geometry::round(lattice, points);
        let mut numbers = vec![0; points.len()];
        for (&given, number) in rounded.order.iter().zip(0..) {
            numbers[given as usize] = number;
        }
        self.meshes.push(Mesh { geometry: Arc::new(rounded.geometry), numbers: numbers.into() });
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Adds an instance of a mesh and returns its number.
    pub fn instance(&mut self, mesh: MeshId) -> InstanceId {
        self.instances.push(mesh);
        InstanceId(self.instances.len() as u32 - 1)
    }

    /// Sets the frames a second of the stream's clock: positive, 60 by default.
    #[must_use]
    pub const fn fps(mut self, fps: f32) -> Self {
        self.fps = fps;
        self
    }

    /// Sets the least difference of an AO value that is sent, in 255ths: 1 to 255, 8 by default. The finest points of a mesh
    /// may be off by twice as much ([`EncoderSettings::finest_threshold`]).
    #[must_use]
    pub const fn threshold(mut self, threshold: u8) -> Self {
        self.threshold = threshold;
        self
    }

    /// Sets how blocks are compressed: [`BlockCoder::Range`] by default.
    #[must_use]
    pub const fn coder(mut self, coder: BlockCoder) -> Self {
        self.coder = coder;
        self
    }

    /// Sets the digest of the scene's files. A client that has another scene open refuses the stream. All zeros, the
    /// default, if there is no digest.
    #[must_use]
    pub const fn scene_digest(mut self, digest: [u8; 32]) -> Self {
        self.digest = digest;
        self
    }

    /// Sets what clients are told of the tracer: nothing by default.
    #[must_use]
    pub const fn trace(mut self, trace: TraceInfo) -> Self {
        self.trace = Some(trace);
        self
    }

    /// Sets which clients may join: all that can connect, by default.
    #[must_use]
    pub fn access(mut self, access: Access) -> Self {
        self.access = access;
        self
    }

    /// Sets the limits of the stream and its sessions.
    #[must_use]
    pub const fn limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// Makes the publisher. Counts, tables and the encoder follow from the meshes and instances.
    ///
    /// # Errors
    /// [`PublishError::Setting`] for a setting out of its range, [`PublishError::NoMesh`] for an instance of a mesh that was
    /// not added, [`PublishError::Scene`] for more points or instances than the limits allow or a kernel radius that makes
    /// no lattice.
    pub fn build(self) -> Result<Publisher, PublishError> {
        self.check()?;
        let info = SceneInfo::new(
            &self.name,
            self.digest,
            self.fps,
            self.threshold,
            self.coder.id(),
            PointSource::SENT,
        );
        let info = self.trace.into_iter().fold(info, SceneInfo::with_trace);
        let sets = self.meshes.iter().map(|mesh| SetEntry::from(mesh.geometry.layout())).collect();
        let member = |mesh: &MeshId| MemberEntry { set: mesh.0, needs: Needs::empty() };
        let members = self.instances.iter().map(member).collect();
        let scene = SceneTable::new(info, SceneEntries::Surface { sets, members }, &self.limits)?;
        let geometry = self.meshes.iter().map(|mesh| Arc::clone(&mesh.geometry)).collect();
        let settings = EncoderSettings::new(self.threshold, GeometrySource::Sent);
        let Layout::Surface(layout) = scene.layout() else {
            // The entries are those of profile `surface`.
            return Err(PublishError::Setting { setting: "profile", range: "surface" });
        };
        let encoder = Encoder::new(Arc::clone(layout), geometry, settings)?;
        let of = |mesh: &MeshId| Arc::clone(&self.meshes[mesh.0 as usize].numbers);
        let numbers = self.instances.iter().map(of).collect();
        Ok(Publisher::new(Arc::new(scene), encoder, self.coder, numbers, (self.access, self.limits)))
    }

    /// Checks what the scene table does not.
    fn check(&self) -> Result<(), PublishError> {
        let refuse = |setting, range| Err(PublishError::Setting { setting, range });
        if !(self.fps > 0.0 && self.fps.is_finite()) {
            return refuse("fps", "a positive number");
        }
        if self.threshold == 0 {
            return refuse("threshold", "1 to 255");
        }
        let meshes = self.meshes.len() as u32;
        match (0..).zip(&self.instances).find(|(_, mesh)| mesh.0 >= meshes) {
            Some((instance, mesh)) => Err(PublishError::NoMesh { instance, mesh: mesh.0, meshes }),
            None => Ok(()),
        }
    }
}
