//! SCENE: the scene table, with facts about the stream and the layout of every instance's points.
//!
//! The scene table is one [`SceneHeader`] and the batches after it, in order, each in a SCENE frame of its own. Profile
//! `paper` has [`InstanceBatch`]es; profile `surface` has [`SetBatch`]es, then [`MemberBatch`]es. The table is all that
//! a client needs to build the codec's layout. A client has its own meshes and animation.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, MemberBatch, Message, Needs, PointSource, SetBatch, Text, finite, require};
use crate::{CoderId, FrameType, Profile};

/// Largest number of entries in a SCENE frame.
pub const MAX_BATCH: usize = 512;

wire_enum! {
    /// Way to compute the AO of a point from its rays. Unknown values are kept.
    #[derive(Encode, Decode)]
    pub struct Occlusion(u8), unknown "occlusion" {
        /// Mean of `min(hit distance, radius) / radius`: near occluders darken more.
        OBSCURANCE = 0 => "obscurance",
        /// Share of the rays that hit nothing within the radius.
        BINARY = 1 => "binary",
    }
}

/// Content of the first SCENE frame: facts about the whole stream. Programs use [`SceneInfo`](crate::SceneInfo), which
/// omits the fields that follow from the entries.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneHeader {
    /// Name of the scene, for display.
    pub name: Text<64>,
    /// Path or built-in name as typed at the server, so that a user can open the same scene.
    pub source: Text<512>,
    /// Digest of the scene's files, or of a built-in scene's name and version. A client with another scene must report
    /// an error and not draw a wrong picture.
    pub digest: [u8; 32],
    /// Profile of the stream.
    pub profile: Profile,
    /// Bits of a packed point: 32, 24 or 16. In profile `surface` it selects the precision of lattices and normals.
    pub point_bits: u8,
    /// Block coder of the stream. Single blocks may be stored.
    pub coder: CoderId,
    /// Source of the points at clients; profile `surface` only.
    pub geometry: PointSource,
    /// Frames per second of the stream's own clock, positive.
    pub fps: f32,
    /// Number of frames that the server plans to send; 0 if unknown.
    pub frames_hint: u32,
    /// AO radius in metres, positive.
    pub radius_m: f32,
    /// Rays per point.
    pub rays: u32,
    /// Way to compute AO from the rays.
    pub occlusion: Occlusion,
    /// A point is sent when its AO byte differs from the sent one by at least this many 255ths.
    pub threshold: u8,
    /// Seed of points and rays.
    pub seed: u64,
    /// Requested points per square metre of surface, positive.
    pub points_per_m2: f32,
    /// Requested minimum of points on every mesh, however small it is.
    pub min_points: u32,
    /// Cells of the whole stream; 0 in profile `surface`.
    pub cell_capacity: u32,
    /// Point sets; 0 in profile `paper`.
    pub set_count: u32,
    /// Instances.
    pub instance_count: u32,
    /// Points of all instances.
    pub point_count: u32,
    /// Bucket entries planned for each average cell (4 in the paper, section 3.2).
    pub paper_table_slots: f32,
    /// Factor by which the server widens a view's half-angle tangents before it calls a point out of view, at least 1.
    pub view_margin: f32,
    /// Distance of neighbouring points on a picture of 1,080 rows, pixels; 0 if all points are kept. At most 1,024.
    pub quality: f32,
}

fields!(SceneHeader {
    name,
    source,
    digest,
    profile as Profile,
    point_bits,
    coder as CoderId,
    geometry,
    fps,
    frames_hint,
    radius_m,
    rays,
    occlusion,
    threshold,
    seed,
    points_per_m2,
    min_points,
    cell_capacity,
    set_count,
    instance_count,
    point_count,
    paper_table_slots,
    view_margin,
    quality,
});

/// One instance of a `paper` stream: its grid, its buckets, its points.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct InstanceEntry {
    /// Corner of the grid in instance-local space, metres.
    pub origin: [f32; 3],
    /// Edge of a cell, metres, positive.
    pub edge: f32,
    /// Cells along each axis, at least 1.
    pub dims: [u32; 3],
    /// First bucket in the stream's bucket table.
    pub first_bucket: u32,
    /// Buckets, a power of two.
    pub bucket_count: u32,
    /// Kernel radius r of the paper's Eq. 2, metres, positive.
    pub kernel_radius: f32,
    /// Points.
    pub points: u32,
    /// Features that it needs.
    pub needs: Needs,
}

/// A batch of the instances of a `paper` stream.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct InstanceBatch {
    /// Index of the first entry. Earlier batches hold the entries before it.
    pub first: u32,
    /// The entries, 1 to [`MAX_BATCH`].
    pub entries: Vec<InstanceEntry>,
}

/// Payload of a SCENE frame.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub enum Scene {
    /// The header, in the first frame.
    Info(SceneHeader),
    /// A batch of instances, in profile `paper`.
    Instances(InstanceBatch),
    /// A batch of point sets, in profile `surface`.
    Sets(SetBatch),
    /// A batch of instances after all sets, in profile `surface`.
    Members(MemberBatch),
}

fn positive(value: f32, field: &'static str) -> Result<(), FieldError> {
    require(value > 0.0 && value.is_finite(), field, "is not a positive number")
}

impl SceneHeader {
    fn check(&self) -> Result<(), FieldError> {
        require(matches!(self.point_bits, 16 | 24 | 32), "point_bits", "must be 16, 24 or 32")?;
        positive(self.fps, "fps")?;
        positive(self.radius_m, "radius_m")?;
        positive(self.points_per_m2, "points_per_m2")?;
        positive(self.paper_table_slots, "paper_table_slots")?;
        positive(self.view_margin, "view_margin")?;
        require(self.view_margin >= 1.0, "view_margin", "is below 1")?;
        require((0.0..=1024.0).contains(&self.quality), "quality", "is not 0 to 1024")
    }
}

impl InstanceEntry {
    fn check(&self) -> Result<(), FieldError> {
        finite(&self.origin, "origin")?;
        positive(self.edge, "edge")?;
        require(!self.dims.contains(&0), "dims", "has an axis without cells")?;
        require(self.bucket_count.is_power_of_two(), "bucket_count", "is not a power of two")?;
        positive(self.kernel_radius, "kernel_radius")
    }
}

impl Payload for Scene {
    fn check(&self) -> Result<(), FieldError> {
        match self {
            Self::Info(info) => info.check(),
            Self::Instances(batch) => {
                let count = batch.entries.len();
                require((1..=MAX_BATCH).contains(&count), "entries", "must have 1 to 512 instances")?;
                batch.entries.iter().try_for_each(InstanceEntry::check)
            }
            Self::Sets(batch) => batch.check(),
            Self::Members(batch) => batch.check(),
        }
    }
}

impl Message for Scene {
    const KIND: FrameType = FrameType::SCENE;
    const NAME: &'static str = "SCENE";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    fn info() -> SceneHeader {
        SceneHeader {
            name: Text::new("hall").unwrap(),
            source: Text::new("a/hall.glb").unwrap(),
            digest: [0xab; 32],
            profile: Profile::PAPER,
            point_bits: 32,
            coder: CoderId::ZSTD,
            geometry: PointSource::SHARED,
            fps: 60.0,
            frames_hint: 300,
            radius_m: 0.5,
            rays: 192,
            occlusion: Occlusion::OBSCURANCE,
            threshold: 8,
            seed: 1,
            points_per_m2: 256.0,
            min_points: 48,
            cell_capacity: 4096,
            set_count: 3,
            instance_count: 2,
            point_count: 20_000,
            paper_table_slots: 4.0,
            view_margin: 1.25,
            quality: 4.0,
        }
    }

    const ENTRY: InstanceEntry = InstanceEntry {
        origin: [-1.0, 0.0, 1.0],
        edge: 0.5,
        dims: [4, 5, 6],
        first_bucket: 7,
        bucket_count: 8,
        kernel_radius: 0.25,
        points: 9,
        needs: Needs::SKIN.union(Needs::MASKED),
    };

    #[test]
    fn golden_bytes_of_the_info() {
        golden(
            &Scene::Info(info()),
            "00000000 0400000000000000 68616c6c 0a00000000000000 612f68616c6c2e676c62 \
             abababababababababababababababababababababababababababababababab 01 20 02 01 00007042 2c010000 \
             0000003f c0000000 00 08 0100000000000000 00008043 30000000 00100000 03000000 02000000 204e0000 \
             00008040 0000a03f 00008040",
        );
    }

    #[test]
    fn golden_bytes_of_a_batch() {
        golden(
            &Scene::Instances(InstanceBatch { first: 1, entries: vec![ENTRY] }),
            "01000000 01000000 0100000000000000 000080bf 00000000 0000803f 0000003f 04000000 05000000 06000000 \
             07000000 08000000 0000803e 09000000 11000000",
        );
    }

    #[test]
    fn a_full_batch_fits_a_message() {
        let batch = |count| Scene::Instances(InstanceBatch { first: 0, entries: vec![ENTRY; count] });
        let bytes = batch(MAX_BATCH).to_payload().unwrap();
        assert_eq!(Scene::from_payload(&bytes).unwrap(), batch(MAX_BATCH));
        assert!(batch(MAX_BATCH + 1).to_payload().is_err());
        assert!(batch(0).to_payload().is_err());
        let mut bytes = bytes;
        // A count of 2^64 - 1 entries must be refused before anything is allocated for it.
        bytes[8..16].copy_from_slice(&[0xff; 8]);
        assert!(Scene::from_payload(&bytes).is_err());
    }

    #[test]
    fn values_that_make_no_sense_are_refused() {
        for bad in [
            SceneHeader { fps: 0.0, ..info() },
            SceneHeader { radius_m: f32::NAN, ..info() },
            SceneHeader { points_per_m2: -1.0, ..info() },
            SceneHeader { paper_table_slots: f32::INFINITY, ..info() },
            SceneHeader { view_margin: 0.5, ..info() },
            SceneHeader { quality: f32::NAN, ..info() },
            SceneHeader { quality: -1.0, ..info() },
            SceneHeader { point_bits: 31, ..info() },
        ] {
            assert!(Scene::Info(bad).to_payload().is_err());
        }
        for bad in [
            InstanceEntry { origin: [0.0, f32::NAN, 0.0], ..ENTRY },
            InstanceEntry { edge: 0.0, ..ENTRY },
            InstanceEntry { dims: [1, 0, 1], ..ENTRY },
            InstanceEntry { bucket_count: 3, ..ENTRY },
            InstanceEntry { bucket_count: 0, ..ENTRY },
            InstanceEntry { kernel_radius: f32::INFINITY, ..ENTRY },
        ] {
            let batch = InstanceBatch { first: 0, entries: vec![ENTRY, bad] };
            assert!(Scene::Instances(batch).to_payload().is_err());
        }
    }
}
