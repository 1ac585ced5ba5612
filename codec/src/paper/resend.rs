//! The resend rule: it sends a point again if it differs enough from the value sent last.
//!
//! The rule compares with the value that clients hold, as last sent and packed, and not with the last frame. So a slow
//! drift is sent as soon as it adds up. A client is never off by the threshold or more (paper, section 3.3), unless
//! its packing is coarser than that.

use super::{Grid, PointFormat, PointSample};
use crate::memory;

/// Smallest cosine between the current normal and the one sent that counts as unchanged.
const MIN_NORMAL_COSINE: f32 = 0.6;
/// Largest distance that counts as unchanged, in cell edges: 3 of the 31 steps of a packed position.
const MAX_DRIFT_EDGES: f32 = 3.0 / 31.0;

/// The rule by which the AO of a point is sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResendAo {
    /// Smallest difference that is sent, in 255ths; at least 1.
    pub threshold: u8,
    /// Packing of the points.
    pub format: PointFormat,
}

impl ResendAo {
    /// Returns whether the byte `now` differs from the byte of clients by the threshold, and sending it would change
    /// that byte.
    ///
    /// The nearest byte that a coarse packing has may be off by the threshold. So a client is off by less than the
    /// threshold, or by at most [`PointFormat::max_ao_error`].
    #[inline]
    #[must_use]
    pub const fn is_due(&self, now: u8, held: u8) -> bool {
        now.abs_diff(held) >= self.threshold && self.format.held_ao(now) != held
    }
}

/// Position and normal of a point, metres and unit length, instance-local.
pub(super) type PointPlace = ([f32; 3], [f32; 3]);

/// Names a point in three ways.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointRef {
    pub(super) id: u32,
    pub(super) instance: usize,
    /// Number of the point in its instance.
    pub(super) number: usize,
}

/// Returns whether a point of a deforming instance moved or turned enough: farther than 3/31 of a cell edge, into
/// another cell, or with a cosine of its normals below 0.6.
fn place_changed(grid: &Grid, now: PointPlace, sent: PointPlace) -> bool {
    let limit = grid.edge() * MAX_DRIFT_EDGES;
    let moved: [f32; 3] = std::array::from_fn(|axis| now.0[axis] - sent.0[axis]);
    dot(moved, moved) > limit * limit
        || dot(now.1, sent.1) < MIN_NORMAL_COSINE
        || (now.0 != sent.0 && grid.locate(now.0).cell != grid.locate(sent.0).cell)
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The values that clients were sent last, and the points that the next frame sends.
#[derive(Debug)]
pub(super) struct Resend {
    rule: ResendAo,
    /// By point id: the byte of clients after packing; `None` if the point was never sent.
    ao: Vec<Option<u8>>,
    /// Places of the points of deforming instances, by instance and number. Other places never change.
    places: Vec<Vec<PointPlace>>,
    /// Points that the next frame sends.
    due: Vec<(u32, PointSample)>,
}

impl Resend {
    /// Creates the rule before anything was sent. `counts` has the number of points of every instance and whether it
    /// deforms.
    pub(super) fn new(rule: ResendAo, counts: impl Iterator<Item = (u32, bool)>) -> Resend {
        let mut total = 0;
        let places = counts.map(|(points, deforms)| {
            total += points as usize;
            // Only compared after the point was sent, and known then.
            vec![PointPlace::default(); if deforms { points as usize } else { 0 }]
        });
        let places = places.collect();
        Resend { rule, ao: vec![None; total], places, due: Vec::new() }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        let places = memory::list(&self.places) + self.places.iter().map(memory::list).sum::<usize>();
        memory::list(&self.ao) + places + memory::list(&self.due)
    }

    /// Returns whether clients are to be sent the current values of a point.
    pub(super) fn is_due(
        &self,
        grid: &Grid,
        PointRef { id, instance, number }: PointRef,
        now: &PointSample,
    ) -> bool {
        let sent_place = self.places[instance].get(number);
        let moved = || sent_place.is_some_and(|sent| place_changed(grid, (now.local, now.normal), *sent));
        self.ao[id as usize].is_none_or(|sent| self.rule.is_due(now.ao, sent)) || moved()
    }

    /// Sends a point with the next frame.
    pub(super) fn push(&mut self, point: u32, sample: PointSample) {
        self.due.push((point, sample));
    }

    /// Takes the points that the next frame sends, by ascending point id.
    pub(super) fn take_due(&mut self) -> Vec<(u32, PointSample)> {
        let mut due = std::mem::take(&mut self.due);
        due.sort_by_key(|(point, _)| *point);
        due
    }

    /// Records that a point is being sent.
    pub(super) fn record(&mut self, PointRef { id, instance, number }: PointRef, sample: &PointSample) {
        self.ao[id as usize] = Some(self.rule.format.held_ao(sample.ao));
        if let Some(place) = self.places[instance].get_mut(number) {
            *place = (sample.local, sample.normal);
        }
    }

    /// Takes a buffer back for the next frame.
    pub(super) fn reuse(&mut self, mut due: Vec<(u32, PointSample)>) {
        due.clear();
        self.due = due;
    }

    /// Returns the AO byte of a point as clients hold it; `None` if it was never sent.
    pub(super) fn ao(&self, point: u32) -> Option<u8> {
        self.ao.get(point as usize).copied().flatten()
    }

    /// Returns the place of a point of a deforming instance as last sent.
    pub(super) fn place(&self, instance: usize, number: usize) -> Option<PointPlace> {
        self.places.get(instance)?.get(number).copied()
    }
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
        const Y: [f32; 3] = [0.0, 1.0, 0.0];
        let grid = Grid::new([0.0; 3], 0.31, [10, 10, 10]).unwrap();
        let sent = ([0.15; 3], Y);
        assert!(!place_changed(&grid, ([0.15 + 0.029, 0.15, 0.15], Y), sent));
        assert!(place_changed(&grid, ([0.15 + 0.031, 0.15, 0.15], Y), sent));
        assert!(place_changed(&grid, (sent.0, [0.81, 0.59, 0.0]), sent));
        assert!(!place_changed(&grid, (sent.0, [0.79, 0.61, 0.0]), sent));
        let edge = ([0.309, 0.1, 0.1], Y);
        assert!(place_changed(&grid, ([0.309 + 0.002, 0.1, 0.1], Y), edge));
    }
}
