//! The scene table of a stream of profile `surface`.

use std::sync::Arc;

use psao_codec::surface::Geometry;
use psao_proto::message::{MemberEntry, SetEntry};
use psao_proto::{Limits, SceneEntries, SceneTable};

use super::grids::info;
use super::{ServerError, ServerSettings};
use crate::scene::Scene;

/// The scene table of a stream whose points are in the order of `geometry`, one for every set.
pub(super) fn table(
    scene: &Scene,
    geometry: &[Arc<Geometry>],
    settings: &ServerSettings,
    limits: &Limits,
) -> Result<SceneTable, ServerError> {
    let sets: Vec<SetEntry> = geometry.iter().map(|geometry| SetEntry::from(geometry.layout())).collect();
    let member = |instance: &crate::scene::Instance| MemberEntry {
        set: instance.rest().index() as u32,
        needs: instance.needs(),
    };
    let members = scene.instances().iter().map(member).collect();
    let mut info = info(scene, settings)?;
    info.geometry = settings.geometry.into();
    Ok(SceneTable::new(info, SceneEntries::Surface { sets, members }, limits)?)
}
