//! The patches in view, and their distances.

use std::collections::BTreeMap;

use psao_reconstruct::{Camera, Size};
use psao_server::world::SceneBvh;
use rayon::prelude::*;

use super::{Patch, PatchPoint, Patches};
use crate::adapter::{FrontHit, SceneView};

/// The places on patches of a picture's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchLookup {
    /// Size of the picture.
    pub size: Size,
    /// Place of each pixel, row by row; `None` for background.
    pub points: Vec<Option<PatchPoint>>,
}

/// Finds the patches of a picture's pixels.
#[must_use]
pub fn patch_lookup(world: &SceneBvh, patches: &Patches, camera: &Camera, size: Size) -> PatchLookup {
    let points = each_pixel(world, camera, size, |front| patches.point(&front.hit, front.back));
    PatchLookup { size, points }
}

/// Returns the distance in metres of the nearest pixel of each patch in view.
pub(super) fn visible(
    world: &SceneBvh,
    patches: &Patches,
    camera: &Camera,
    size: Size,
) -> BTreeMap<Patch, f32> {
    let seen =
        each_pixel(world, camera, size, |front| (patches.point(&front.hit, front.back).patch, front.t));
    let mut nearest = BTreeMap::new();
    for (patch, t) in seen.into_iter().flatten() {
        let found = nearest.entry(patch).or_insert(t);
        *found = t.min(*found);
    }
    nearest
}

fn each_pixel<T: Send + Clone>(
    world: &SceneBvh,
    camera: &Camera,
    size: Size,
    of: impl Fn(&FrontHit) -> T + Sync,
) -> Vec<Option<T>> {
    let view = SceneView::new(world);
    let mut pixels = vec![None; size.pixels()];
    pixels.par_chunks_mut(size.width() as usize).zip(0_u32..size.height()).for_each(|(row, y)| {
        for (pixel, x) in row.iter_mut().zip(0_u32..) {
            let ray = camera.ray(size, x, y);
            *pixel = view.front_hit(ray.origin, ray.direction, f32::INFINITY).map(|front| of(&front));
        }
    });
    pixels
}
