//! Tests of whole views, against Eq. 2 to 4 as the paper writes them.

mod cells;
mod surface;

use proptest::prelude::*;

use super::{Reconstruction, Statistics};
use crate::testing::Reference;
use crate::{GBuffer, Size, Surface};

/// Returns a view of one row of fragments.
fn row(fragments: &[impl Copy + Into<Option<Surface>>]) -> GBuffer {
    let size = Size::new(u32::try_from(fragments.len()).unwrap(), 1).unwrap();
    GBuffer::from_fragments(size, fragments.iter().map(|&fragment| fragment.into()).collect()).unwrap()
}

/// Largest differences of a reconstruction from its reference.
#[derive(Clone, Copy)]
struct Bounds {
    /// Largest difference of a value where no criterion is near its threshold.
    value: f64,
    /// One in this many fragments may be near a threshold.
    near_thresholds: u64,
}

/// Compares a reconstruction with the reference of each fragment.
fn check(
    found: &Reconstruction,
    view: &GBuffer,
    bounds: Bounds,
    reference: impl Fn(&Surface) -> Reference,
) -> Result<(), TestCaseError> {
    let mut sum = Statistics::default();
    let mut near_thresholds = 0;
    for (pixel, &value) in found.image.values().iter().enumerate() {
        let Some(fragment) = view.fragment(pixel) else {
            prop_assert_eq!(value, 1.0);
            continue;
        };
        let wanted = reference(&fragment);
        near_thresholds += u64::from(wanted.near_threshold);
        let difference = (f64::from(value) - wanted.ao).abs();
        prop_assert!(wanted.near_threshold || difference < bounds.value, "{} {:?}", value, wanted);
        sum = sum.plus(Statistics {
            fragments: 1,
            unsupported: u64::from(wanted.blended == 0),
            blended: wanted.blended,
        });
    }
    prop_assert!(
        near_thresholds * bounds.near_thresholds <= sum.fragments + 9,
        "{} close calls",
        near_thresholds
    );
    if near_thresholds == 0 {
        prop_assert_eq!(found.statistics, sum);
    }
    Ok(())
}

/// Runs `work` on a pool of one thread.
fn on_one_thread<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "rayon")]
    let result = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work);
    #[cfg(not(feature = "rayon"))]
    let result = work();
    result
}
