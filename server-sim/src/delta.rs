//! Which points are sent again: those that differ from the value last sent by enough.
//!
//! The comparison is with the value last sent, never with the last frame's: a slow drift is sent as soon as it adds
//! up, so a client is never off by the threshold or more (stream design, profile `paper`; paper, section 3.3).

use glam::Vec3;
use psao_codec::cells::Grid;

/// Smallest cosine between the normal now and the one sent that still counts as the same.
const SAME_NORMAL: f32 = 0.6;
/// Positions may drift by this share of a cell's edge: 3 of the 31 steps of a packed position.
const SAME_POSITION: f32 = 3.0 / 31.0;

/// Whether an AO byte differs enough from the one last sent.
#[inline]
#[must_use]
pub fn ao_changed(now: u8, sent: u8, threshold: u8) -> bool {
    now.abs_diff(sent) >= threshold
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
    use super::*;

    #[test]
    fn ao_counts_from_the_threshold_on() {
        assert!(!ao_changed(107, 100, 8) && ao_changed(108, 100, 8) && ao_changed(92, 100, 8));
        assert!(!ao_changed(93, 100, 8) && ao_changed(0, 255, 255) && !ao_changed(5, 5, 1));
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
