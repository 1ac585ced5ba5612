//! The scene table and the encoder of a stream: the only place where the server knows the profiles apart.

use std::sync::Arc;

use psao_codec::surface::{self, EncoderSettings, Geometry};
use psao_codec::{Encoder, Layout, paper};
use psao_proto::message::{MemberEntry, Occlusion as WireOcclusion, PointSource, SetEntry, Text};
use psao_proto::{Limits, PaperInfo, Profile, SceneEntries, SceneInfo, SceneTable, TraceInfo};

use super::grids::grids;
use super::settings::ServerSettings;
use super::{EncodeStage, ServerError};
use crate::ao::Occlusion;
use crate::points::{ScenePoints, order_at_rest};
use crate::scene::{Motion, Scene};

/// Kernel radius in Poisson-disk radii of the points, where none is asked for. The distance of neighbours is 1.86 of them.
const SURFACE_KERNEL: f32 = 2.8;
pub(super) const PAPER_KERNEL: f32 = 2.5;

/// Returns whether a stream treats points inside solids and points that no camera sees differently from others.
pub(super) fn tells_points_apart(settings: &ServerSettings) -> bool {
    settings.profile == Profile::SURFACE
}

/// Makes the encode stage of a stream; brings the points into the stream's order.
pub(super) fn encode_stage(
    scene: &Arc<Scene>,
    points: &mut ScenePoints,
    settings: &ServerSettings,
) -> Result<EncodeStage, ServerError> {
    let mut geometry = Vec::new();
    let table = if settings.profile == Profile::SURFACE {
        geometry =
            order_at_rest(scene, points, settings.precision()?, settings.kernel.unwrap_or(SURFACE_KERNEL));
        surface_table(scene, &geometry, settings)?
    } else {
        paper_table(scene, points, settings)?
    };
    let encoder = match table.layout() {
        Layout::Paper(layout) => {
            let counts: Vec<u32> = points.offsets().windows(2).map(|pair| pair[1] - pair[0]).collect();
            let instances = scene.instances().iter();
            let deforms: Vec<bool> =
                instances.map(|instance| instance.motion() == Motion::Deforming).collect();
            let encoder = paper::Encoder::new(Arc::clone(layout), &counts)?;
            Encoder::Paper(Box::new(encoder.with_threshold(settings.threshold, &deforms)))
        }
        Layout::Surface(layout) => {
            let ServerSettings { threshold, geometry: source, budget, .. } = *settings;
            let settings = EncoderSettings::new(threshold, source).with_budget(budget);
            Encoder::Surface(Box::new(surface::Encoder::new(Arc::clone(layout), geometry, settings)?))
        }
    };
    Ok(EncodeStage::new(encoder, table, settings.coder))
}

/// The scene table of a stream of profile `paper`.
fn paper_table(
    scene: &Arc<Scene>,
    points: &ScenePoints,
    settings: &ServerSettings,
) -> Result<SceneTable, ServerError> {
    let (entries, cells) = grids(scene, points, settings)?;
    let paper = PaperInfo::new(cells).with_table_slots(settings.table_slots);
    let info = info(scene, settings)?.with_paper(paper);
    Ok(SceneTable::new(info, SceneEntries::Cells(entries), &Limits::default())?)
}

/// The scene table of a stream of profile `surface` whose points are in the order of `geometry`, one for every set.
fn surface_table(
    scene: &Scene,
    geometry: &[Arc<Geometry>],
    settings: &ServerSettings,
) -> Result<SceneTable, ServerError> {
    let sets: Vec<SetEntry> = geometry.iter().map(|geometry| SetEntry::from(geometry.layout())).collect();
    let member = |instance: &crate::scene::Instance| MemberEntry {
        set: instance.rest().index() as u32,
        needs: instance.needs(),
    };
    let members = scene.instances().iter().map(member).collect();
    let mut info = info(scene, settings)?;
    info.geometry = settings.geometry.into();
    Ok(SceneTable::new(info, SceneEntries::Surface { sets, members }, &Limits::default())?)
}

/// The stream as a whole, but for what only one of the profiles has.
fn info(scene: &Scene, settings: &ServerSettings) -> Result<SceneInfo, ServerError> {
    let source =
        Text::new(scene.source()).map_err(|_| ServerError::Source { length: scene.source().len() })?;
    let occlusion = match settings.ao.kind {
        Occlusion::Obscurance => WireOcclusion::OBSCURANCE,
        Occlusion::Binary => WireOcclusion::BINARY,
    };
    // A stream may have its minimum of points only; the wire wants a positive density.
    let per_m2 = settings.points.per_m2.max(f32::MIN_POSITIVE);
    let trace = TraceInfo::new(settings.ao.rays, settings.ao.radius)
        .with_occlusion(occlusion)
        .with_seed(settings.points.seed)
        .with_density(per_m2, settings.points.minimum)
        .with_view_margin(settings.view_margin)
        .with_quality(settings.levels_by_view().unwrap_or(0.0));
    let ServerSettings { fps, threshold, coder, .. } = *settings;
    let info = SceneInfo::new(scene.name(), *scene.digest(), fps, threshold, coder.id(), PointSource::SENT);
    Ok(info
        .with_source(source)
        .with_point_bits(settings.bits)
        .with_frames_hint(settings.frames_hint)
        .with_trace(trace)
        .with_paper(PaperInfo::new(0).with_table_slots(settings.table_slots)))
}
