//! Every instance's grid, buckets and kernel: the static layout of a stream of profile `paper` (paper, section 3.2).

use std::sync::Arc;

use psao_codec::paper::bucket_count;
use psao_proto::message::{InstanceEntry, Needs};
use rayon::prelude::*;

use super::ServerError;
use super::profile::PAPER_KERNEL;
use super::settings::ServerSettings;
use crate::bvh::Bounds;
use crate::points::{PointSet, ScenePoints};
use crate::scene::{Geometry, InstanceId, Motion, Scene};

/// Most moments at which the clip is looked at for the bounds of what deforms.
const MAX_MOMENTS: u32 = 256;
/// Share of the size by which bounds of deforming instances are padded, for the moments between.
const PADDING: f32 = 0.05;
/// Entries of a bucket (paper, section 3.2).
const ENTRIES: u64 = 8;
/// Cells that a 22-bit cell index can name.
const MOST_CELLS: u64 = 1 << 22;

/// Grids of the instances, and the most cells that they can have together.
pub(super) fn grids(
    scene: &Arc<Scene>,
    points: &ScenePoints,
    settings: &ServerSettings,
) -> Result<(Vec<InstanceEntry>, u32), ServerError> {
    let bounds = local_bounds(scene, settings);
    let mut first_bucket = 0u32;
    let mut cells = 0u64;
    let mut entries = Vec::with_capacity(scene.instances().len());
    for (instance, bounds) in scene.instances().iter().zip(bounds) {
        let set = &points.sets()[instance.rest().index()];
        let entry = entry(set, bounds, first_bucket, instance.needs(), settings);
        // A cell takes an entry of a bucket and holds at least one point.
        cells += (u64::from(entry.bucket_count) * ENTRIES).min(u64::from(entry.points));
        first_bucket = first_bucket.checked_add(entry.bucket_count).ok_or(ServerError::Buckets)?;
        entries.push(entry);
    }
    Ok((entries, cells.min(MOST_CELLS) as u32))
}

fn entry(
    set: &PointSet,
    bounds: Bounds,
    first_bucket: u32,
    needs: Needs,
    settings: &ServerSettings,
) -> InstanceEntry {
    // Paper, section 3.2, and the authors' prototype: cells of four Poisson-disk radii.
    let edge = 4.0 * set.radius();
    let bounds = if bounds.is_empty() { Bounds::new(glam::Vec3::ZERO, glam::Vec3::ZERO) } else { bounds };
    // A hundredth of a cell keeps what lies in the outermost plane inside, whatever the rounding.
    let low = bounds.min() - 0.01 * edge;
    let cells = (bounds.max() + 0.01 * edge - low) / edge;
    InstanceEntry {
        origin: low.to_array(),
        edge,
        dims: cells.to_array().map(|cells| (cells.ceil() as u32).max(1)),
        first_bucket,
        bucket_count: bucket_count(set.area() as f32, edge, settings.table_slots),
        kernel_radius: settings.kernel.unwrap_or(PAPER_KERNEL) * set.radius(),
        points: set.points().len() as u32,
        needs,
    }
}

/// Local bounds of every instance over the whole clip.
fn local_bounds(scene: &Arc<Scene>, settings: &ServerSettings) -> Vec<Bounds> {
    let around = |geometry: &Geometry| Bounds::around(geometry.positions().iter().copied());
    let mut all: Vec<Bounds> =
        scene.instances().iter().map(|instance| around(scene.rest(instance).geometry())).collect();
    let deforming: Vec<usize> =
        (0..all.len()).filter(|&i| scene.instances()[i].motion() == Motion::Deforming).collect();
    if deforming.is_empty() {
        return all;
    }
    deforming.iter().for_each(|&instance| all[instance] = Bounds::EMPTY);
    let moments = ((scene.duration_s() * f64::from(settings.fps)).ceil() as u32).clamp(1, MAX_MOMENTS);
    let seen: Vec<Vec<Bounds>> = (0..=moments)
        .into_par_iter()
        .map_init(Geometry::default, |geometry, moment| {
            let pose = scene.pose(scene.duration_s() * f64::from(moment) / f64::from(moments));
            let bounds = deforming.iter().map(|&instance| {
                scene.local_geometry(InstanceId(instance as u32), &pose, geometry);
                around(geometry)
            });
            bounds.collect()
        })
        .collect();
    for moment in seen {
        for (&instance, bounds) in deforming.iter().zip(moment) {
            all[instance] = all[instance].union(bounds);
        }
    }
    for &instance in &deforming {
        all[instance] = all[instance].grown(PADDING * all[instance].size().max_element());
    }
    all
}
