//! Facts about a stream as a whole: six required ones and optional ones.

use psao_codec::setters;

use crate::message::{Occlusion, PointSource, SceneHeader, Text};
use crate::{CoderId, Profile};

/// The facts about a stream.
///
/// Six of them are required. The others have neutral values, so that an engine with its own tracer gives only the facts
/// that apply. Profile, instances, sets and points are not among them: a [`SceneTable`](crate::SceneTable) derives
/// those from its entries.
///
/// ```
/// use psao_proto::message::PointSource;
/// use psao_proto::{CoderId, SceneInfo, TraceInfo};
///
/// let info = SceneInfo::new("my scene", [7; 32], 60.0, 8, CoderId::RANGE, PointSource::SENT)
///     .with_trace(TraceInfo::new(64, 0.5).with_seed(3));
/// assert_eq!(info.trace.map(|trace| trace.rays), Some(64));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SceneInfo {
    /// Name of the scene, for display.
    pub name: Text<64>,
    /// Digest of the scene's content. A client that has another scene open refuses the stream, because its pictures
    /// would be wrong. All zeros if the server has no digest.
    pub digest: [u8; 32],
    /// Frames per second of the stream's own clock, positive.
    pub fps: f32,
    /// Least difference of an AO byte from its last sent value, in 255ths, at which the point is sent again.
    pub threshold: u8,
    /// Block coder of the stream. Single blocks may be stored.
    pub coder: CoderId,
    /// Source of the points at clients. Streams of profile `paper` have [`PointSource::SENT`].
    pub geometry: PointSource,
    /// Path or built-in name as typed at the server, so that a user can open the same scene. Empty by default.
    pub source: Text<512>,
    /// Bits of a packed point: 32 (the default), 24 or 16. In profile `surface` it tells the precision of lattices and
    /// normals, for display.
    pub point_bits: u8,
    /// Number of frames that the server plans to send; 0, the default, if unknown.
    pub frames_hint: u32,
    /// Settings of points and tracer, if the server gives them.
    pub trace: Option<TraceInfo>,
    /// Sizes of the paper's tables. Required in profile `paper`.
    pub paper: Option<PaperInfo>,
}

impl SceneInfo {
    /// Creates the facts from the six required ones. See the fields of the same names; the name is cut to 64 bytes.
    #[must_use]
    pub fn new(
        name: &str,
        digest: [u8; 32],
        fps: f32,
        threshold: u8,
        coder: CoderId,
        geometry: PointSource,
    ) -> Self {
        Self {
            name: Text::cut(name),
            digest,
            fps,
            threshold,
            coder,
            geometry,
            source: Text::default(),
            point_bits: 32,
            frames_hint: 0,
            trace: None,
            paper: None,
        }
    }

    setters! {
        with_source: source as Text<512>,
        with_point_bits: point_bits as u8,
        with_frames_hint: frames_hint as u32,
    }

    /// Sets [`trace`](Self::trace).
    #[must_use]
    pub const fn with_trace(mut self, trace: TraceInfo) -> Self {
        self.trace = Some(trace);
        self
    }

    /// Sets [`paper`](Self::paper).
    #[must_use]
    pub const fn with_paper(mut self, paper: PaperInfo) -> Self {
        self.paper = Some(paper);
        self
    }

    /// Returns the message that carries these facts and the counts of a table.
    pub(super) fn header(&self, counts: Counts) -> SceneHeader {
        let trace = self.trace.unwrap_or(TraceInfo::NEUTRAL);
        let paper = self.paper.unwrap_or(PaperInfo::NEUTRAL);
        SceneHeader {
            name: self.name.clone(),
            source: self.source.clone(),
            digest: self.digest,
            profile: counts.profile,
            point_bits: self.point_bits,
            coder: self.coder,
            geometry: self.geometry,
            fps: self.fps,
            frames_hint: self.frames_hint,
            radius_m: trace.radius_m,
            rays: trace.rays,
            occlusion: trace.occlusion,
            threshold: self.threshold,
            seed: trace.seed,
            points_per_m2: trace.points_per_m2,
            min_points: trace.min_points,
            cell_capacity: paper.cell_capacity,
            set_count: counts.sets,
            instance_count: counts.instances,
            point_count: counts.points,
            paper_table_slots: paper.table_slots,
            view_margin: trace.view_margin,
            quality: trace.quality,
        }
    }
}

impl From<SceneHeader> for SceneInfo {
    fn from(header: SceneHeader) -> Self {
        let trace = TraceInfo {
            rays: header.rays,
            radius_m: header.radius_m,
            occlusion: header.occlusion,
            seed: header.seed,
            points_per_m2: header.points_per_m2,
            min_points: header.min_points,
            view_margin: header.view_margin,
            quality: header.quality,
        };
        let paper = PaperInfo { cell_capacity: header.cell_capacity, table_slots: header.paper_table_slots };
        let is_paper = header.profile == Profile::PAPER;
        Self {
            name: header.name,
            digest: header.digest,
            fps: header.fps,
            threshold: header.threshold,
            coder: header.coder,
            geometry: header.geometry,
            source: header.source,
            point_bits: header.point_bits,
            frames_hint: header.frames_hint,
            trace: Some(trace).filter(|trace| *trace != TraceInfo::NEUTRAL),
            paper: Some(paper).filter(|paper| is_paper || *paper != PaperInfo::NEUTRAL),
        }
    }
}

/// The part of a [`SceneHeader`] that follows from a table's entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) profile: Profile,
    pub(super) sets: u32,
    pub(super) instances: u32,
    pub(super) points: u32,
}

/// Settings of a server's points and tracer.
///
/// On the wire, a stream without these facts has the values of [`NEUTRAL`](Self::NEUTRAL) in their place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct TraceInfo {
    /// Rays per point.
    pub rays: u32,
    /// AO radius in metres, positive.
    pub radius_m: f32,
    /// Way to compute AO from the rays.
    pub occlusion: Occlusion,
    /// Seed of points and rays.
    pub seed: u64,
    /// Requested points per square metre of surface, positive.
    pub points_per_m2: f32,
    /// Requested minimum of points on every mesh, however small it is.
    pub min_points: u32,
    /// Factor by which the server widens a view's half-angle tangents before a point counts as out of view, at least 1.
    pub view_margin: f32,
    /// Profile `surface`: distance of neighbouring points on a picture of 1,080 rows, in pixels. The server keeps points
    /// only as fine as this; 0 if it keeps all points.
    pub quality: f32,
}

impl TraceInfo {
    /// The values on the wire of a stream without these facts: no rays, one metre, one point per square metre, a margin
    /// of 1, and zeros.
    pub const NEUTRAL: Self = Self {
        rays: 0,
        radius_m: 1.0,
        occlusion: Occlusion::OBSCURANCE,
        seed: 0,
        points_per_m2: 1.0,
        min_points: 0,
        view_margin: 1.0,
        quality: 0.0,
    };

    /// Creates the facts of a tracer that casts `rays` rays per point as far as `radius_m` metres. The others are
    /// those of [`NEUTRAL`](Self::NEUTRAL).
    #[must_use]
    pub const fn new(rays: u32, radius_m: f32) -> Self {
        Self { rays, radius_m, ..Self::NEUTRAL }
    }

    setters! {
        with_occlusion: occlusion as Occlusion,
        with_seed: seed as u64,
        with_view_margin: view_margin as f32,
        with_quality: quality as f32,
    }

    /// Sets [`points_per_m2`](Self::points_per_m2) and [`min_points`](Self::min_points).
    #[must_use]
    pub const fn with_density(mut self, points_per_m2: f32, min_points: u32) -> Self {
        (self.points_per_m2, self.min_points) = (points_per_m2, min_points);
        self
    }
}

/// Sizes of the tables of profile `paper`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PaperInfo {
    /// Cells of the whole stream.
    pub cell_capacity: u32,
    /// Bucket entries planned for each average cell, positive. The paper has 4 (section 3.2).
    pub table_slots: f32,
}

impl PaperInfo {
    /// The values on the wire of a stream without these facts.
    const NEUTRAL: Self = Self::new(0);

    /// Creates the facts of a stream of `cell_capacity` cells, with the paper's 4 entries for each average cell.
    #[must_use]
    pub const fn new(cell_capacity: u32) -> Self {
        Self { cell_capacity, table_slots: 4.0 }
    }

    setters! {
        with_table_slots: table_slots as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info() -> SceneInfo {
        SceneInfo::new("hall", [1; 32], 30.0, 2, CoderId::RANGE, PointSource::SHARED)
    }

    const COUNTS: Counts = Counts { profile: Profile::SURFACE, sets: 1, instances: 2, points: 3 };

    #[test]
    fn facts_survive_the_wire_whether_they_are_there_or_not() {
        let trace = TraceInfo::new(16, 0.25).with_density(64.0, 3).with_view_margin(1.5).with_quality(4.0);
        for info in [
            info(),
            info().with_trace(trace.with_seed(9).with_occlusion(Occlusion::BINARY)),
            info().with_paper(PaperInfo::new(7).with_table_slots(2.0)),
            info().with_source(Text::cut("a/hall.glb")).with_point_bits(24).with_frames_hint(10),
        ] {
            assert_eq!(SceneInfo::from(info.header(COUNTS)), info);
        }
        let paper = Counts { profile: Profile::PAPER, ..COUNTS };
        assert_eq!(SceneInfo::from(info().header(paper)).paper, Some(PaperInfo::NEUTRAL));
    }

    #[test]
    fn a_header_without_optional_facts_is_one_that_readers_take() {
        use crate::message::{Message, Scene};

        let header = info().header(COUNTS);
        assert_eq!((header.rays, header.radius_m, header.paper_table_slots), (0, 1.0, 4.0));
        let scene = Scene::Info(header);
        assert_eq!(Scene::from_payload(&scene.to_payload().unwrap()), Ok(scene));
    }

    #[test]
    fn every_header_is_written_as_it_was_read() {
        let header = info().with_trace(TraceInfo::new(0, 2.0)).header(COUNTS);
        for header in [
            header.clone(),
            SceneHeader { rays: 0, radius_m: 1.0, points_per_m2: 1.0, ..header.clone() },
            SceneHeader { paper_table_slots: 3.0, cell_capacity: 5, ..header },
        ] {
            assert_eq!(SceneInfo::from(header.clone()).header(COUNTS), header);
        }
    }
}
