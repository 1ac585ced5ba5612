//! All fragments of a view, in an order in which neighbours share what they need.

use super::result::{ReconstructError, Reconstruction, Statistics};
use crate::kernel::Blend;
use crate::{AoImage, GBuffer, parallel};

/// Pixels on a side of the tiles in which a view is walked, so that fragments one above the other share their
/// neighbourhood as well as those side by side.
const TILE_PIXELS: usize = 8;

/// Blends every fragment of `view`: `blend` gets make_cache of its thread's own, made by `make_cache` for a band of rows, the
/// fragment's pixel and its instance. Eq. 4 of what it returns is the pixel's value, 1 where no point counts.
///
/// Rows are spread over all cores with the feature `rayon`; the result does not depend on how many there are.
pub(super) fn walk<M>(
    view: &GBuffer,
    make_cache: impl Fn() -> M + Sync,
    blend: impl Fn(&mut M, usize, u32) -> Blend + Sync,
) -> Reconstruction {
    let size = view.size();
    let width = size.width() as usize;
    let mut values = vec![1.0_f32; size.pixels()];
    let bands = parallel::chunks(&mut values, width * TILE_PIXELS, |band, values| {
        let mut cache = make_cache();
        walk_band(view, band * TILE_PIXELS * width, values, |pixel, instance| {
            blend(&mut cache, pixel, instance)
        })
    });
    let statistics = bands.into_iter().fold(Statistics::default(), Statistics::plus);
    Reconstruction { image: AoImage::from_computed(size, values), statistics }
}

/// Walks up to [`TILE_PIXELS`] rows; `first` is the number of the first pixel.
fn walk_band(
    view: &GBuffer,
    first: usize,
    values: &mut [f32],
    mut blend: impl FnMut(usize, u32) -> Blend,
) -> Statistics {
    let width = view.size().width() as usize;
    let mut statistics = Statistics::default();
    for left in (0..width).step_by(TILE_PIXELS) {
        let columns = left..(left + TILE_PIXELS).min(width);
        for row in (0..values.len()).step_by(width) {
            for at in columns.clone().map(|x| row + x) {
                let instance = view.instance()[first + at];
                if instance == GBuffer::NO_INSTANCE {
                    continue;
                }
                let blend = blend(first + at, instance);
                statistics.fragments += 1;
                statistics.blended += u64::from(blend.blended());
                values[at] = blend.mean().unwrap_or_else(|| {
                    statistics.unsupported += 1;
                    1.0
                });
            }
        }
    }
    statistics
}

/// Checks that the view shows no instance that the stream does not have.
pub(super) fn check_instances(view: &GBuffer, instances: usize) -> Result<(), ReconstructError> {
    let unknown = |&&instance: &&u32| instance != GBuffer::NO_INSTANCE && instance as usize >= instances;
    match view.instance().iter().enumerate().find(|(_, instance)| unknown(instance)) {
        Some((pixel, &instance)) => Err(ReconstructError::Instance { pixel, instance, instances }),
        None => Ok(()),
    }
}
