//! Which points are sent again: those that differ from the value last sent by enough.
//!
//! The comparison is with the value that clients hold, as last sent and packed, never with the last frame's: a slow
//! drift is sent as soon as it adds up, so a client is never off by the threshold or more (stream design, profile
//! `paper`; paper, section 3.3), or by more than its packing must.

use glam::Vec3;
use psao_codec::paper::{Grid, PointFormat};

/// Smallest cosine between the normal now and the one sent that still counts as the same.
const SAME_NORMAL: f32 = 0.6;
/// Positions may drift by this share of a cell's edge: 3 of the 31 steps of a packed position.
const SAME_POSITION: f32 = 3.0 / 31.0;

/// When the AO of a point is sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResendAo {
    /// From how many 255ths on, at least 1.
    pub threshold: u8,
    /// How points are packed.
    pub format: PointFormat,
}

impl ResendAo {
    /// Whether the byte `now` differs by the threshold from the one that clients hold, and sending it would change that.
    ///
    /// A packing with few bits may hold a byte that is off by the threshold and still the nearest there is. So a client
    /// is off by less than the threshold, or by no more than [`PointFormat::max_ao_error`].
    #[inline]
    #[must_use]
    pub const fn is_due(&self, now: u8, held: u8) -> bool {
        now.abs_diff(held) >= self.threshold && self.format.held_ao(now) != held
    }
}

/// Whether a point of a deforming instance moved or turned enough: farther than 3/31 of a cell, into another cell, or
/// its normal by more than a cosine of 0.6.
pub(crate) fn place_changed(grid: &Grid, now: (Vec3, Vec3), sent: (Vec3, Vec3)) -> bool {
    let limit = grid.edge() * SAME_POSITION;
    now.0.distance_squared(sent.0) > limit * limit
        || now.1.dot(sent.1) < SAME_NORMAL
        || (now.0 != sent.0 && grid.locate(now.0.into()).cell != grid.locate(sent.0.into()).cell)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn ao_counts_from_the_threshold_on() {
        let due =
            |now, held, threshold| ResendAo { threshold, format: PointFormat::Bits32 }.is_due(now, held);
        assert!(!due(107, 100, 8) && due(108, 100, 8) && due(92, 100, 8));
        assert!(!due(93, 100, 8) && due(0, 255, 255) && !due(5, 5, 1));
    }

    #[test]
    fn what_is_held_as_well_as_can_be_is_not_sent_again() {
        // 31 levels of 8.2 / 255: 99 is the nearest to 103, however low the threshold.
        let coarse = ResendAo { threshold: 2, format: PointFormat::Bits16 };
        assert_eq!(PointFormat::Bits16.held_ao(103), 107);
        assert!(!coarse.is_due(103, 107) && coarse.is_due(103, 99));
    }

    proptest! {
        #[test]
        fn clients_are_off_by_less_than_the_threshold_or_by_what_packing_costs(
            values in prop::collection::vec(any::<u8>(), 1..60), threshold in 1_u8..=255, format in 0_usize..3,
        ) {
            let resend = ResendAo { threshold, format: PointFormat::ALL[format] };
            let mut held = resend.format.held_ao(values[0]);
            for now in values {
                if resend.is_due(now, held) {
                    held = resend.format.held_ao(now);
                    prop_assert!(!resend.is_due(now, held), "it would be sent for ever");
                }
                let off = now.abs_diff(held);
                prop_assert!(off < threshold || off <= resend.format.max_ao_error(), "{} for {}", held, now);
            }
        }
    }

    #[test]
    fn places_count_by_distance_cell_and_normal() {
        let grid = Grid::new([0.0; 3], 0.31, [10, 10, 10]).unwrap();
        let sent = (Vec3::splat(0.15), Vec3::Y);
        assert!(!place_changed(&grid, (sent.0 + Vec3::X * 0.029, Vec3::Y), sent));
        assert!(place_changed(&grid, (sent.0 + Vec3::X * 0.031, Vec3::Y), sent));
        assert!(place_changed(&grid, (sent.0, Vec3::new(0.81, 0.59, 0.0)), sent));
        assert!(!place_changed(&grid, (sent.0, Vec3::new(0.79, 0.61, 0.0)), sent));
        let edge = (Vec3::new(0.309, 0.1, 0.1), Vec3::Y);
        assert!(place_changed(&grid, (edge.0 + Vec3::X * 0.002, Vec3::Y), edge));
    }
}
