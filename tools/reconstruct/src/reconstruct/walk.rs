//! Visits all fragments of a view in tiles, so that neighbours share cached points.

use super::result::{ReconstructError, Reconstruction, Statistics};
use crate::kernel::Support;
use crate::{AoImage, GBuffer, parallel};

/// Side of a tile in pixels. In a tile, fragments above each other share their neighbourhood as well as those beside
/// each other.
const TILE_PIXELS: usize = 8;

/// Computes every fragment of `view`.
///
/// `make_cache` makes the cache of a band of rows. `support` gets that cache, the fragment's pixel and its instance. What it
/// returns is the pixel's value, or 1 where no point counts.
///
/// The feature `rayon` spreads rows over all cores. The result does not depend on their number.
pub(super) fn walk<M>(
    view: &GBuffer,
    make_cache: impl Fn() -> M + Sync,
    support: impl Fn(&mut M, usize, u32) -> Support + Sync,
) -> Reconstruction {
    let size = view.size();
    let width = size.width() as usize;
    let mut values = vec![1.0_f32; size.pixels()];
    let bands = parallel::chunks(&mut values, width * TILE_PIXELS, |band, values| {
        let mut cache = make_cache();
        walk_band(view, band * TILE_PIXELS * width, values, |pixel, instance| {
            support(&mut cache, pixel, instance)
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
    mut support: impl FnMut(usize, u32) -> Support,
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
                let Support { ao, points } = support(first + at, instance);
                statistics.fragments += 1;
                statistics.blended += u64::from(points);
                values[at] = ao.unwrap_or_else(|| {
                    statistics.unsupported += 1;
                    1.0
                });
            }
        }
    }
    statistics
}

/// Checks that the stream has every instance that the view shows.
pub(super) fn check_instances(view: &GBuffer, instances: usize) -> Result<(), ReconstructError> {
    let unknown = |&&instance: &&u32| instance != GBuffer::NO_INSTANCE && instance as usize >= instances;
    match view.instance().iter().enumerate().find(|(_, instance)| unknown(instance)) {
        Some((pixel, &instance)) => Err(ReconstructError::Instance { pixel, instance, instances }),
        None => Ok(()),
    }
}
