//! The cost of telling a client where blocks are.

use std::collections::BTreeMap;

use super::{Extent, Patch};

/// Contexts of a block's width or height: its previous power of two, or none.
const CONTEXTS: usize = 9;
/// Powers of two of a side, 0 unused.
const POWERS: usize = 9;
/// Classes of numbers by their length in bits.
const LENGTHS: usize = 33;

/// A patch whose block changes: its extents before and after the change; `None` without a block.
pub(super) type Changes = BTreeMap<Patch, [Option<Extent>; 2]>;

/// Counts the bits by which an adaptive arithmetic coder would describe the changes of blocks.
///
/// A client assigns places as the server does, so only patches and extents are sent. Each symbol costs the logarithm of
/// its estimated probability (Krichevsky and Trofimov 1981). A real coder takes a little more.
pub(super) struct PlacementCost {
    count: Model<LENGTHS>,
    gap: Model<LENGTHS>,
    /// Whether a block goes away, of patches that have one.
    gone: Model<2>,
    across: [Model<POWERS>; CONTEXTS],
    down: [Model<POWERS>; CONTEXTS * POWERS],
}

/// The symbols of one context so far.
#[derive(Clone, Copy)]
struct Model<const SYMBOLS: usize> {
    counts: [u32; SYMBOLS],
    total: u32,
}

impl PlacementCost {
    pub(super) fn new() -> Self {
        Self {
            count: Model::NEW,
            gap: Model::NEW,
            gone: Model::NEW,
            across: [Model::NEW; CONTEXTS],
            down: [Model::NEW; CONTEXTS * POWERS],
        }
    }

    /// Returns the bytes of a frame's changes, rounded up; 0 without any.
    pub(super) fn bytes(&mut self, changes: &Changes) -> u64 {
        if changes.is_empty() {
            return 0;
        }
        let mut bits = number(&mut self.count, changes.len() as u32);
        let mut next = 0;
        for (&Patch(patch), &[before, after]) in changes {
            bits += number(&mut self.gap, patch - next);
            next = patch + 1;
            if before.is_some() {
                bits += self.gone.bits(usize::from(after.is_none()));
            }
            if let Some(after) = after {
                bits += self.extent(before, after);
            }
        }
        (bits / 8.0).ceil() as u64
    }

    fn extent(&mut self, before: Option<Extent>, after: Extent) -> f64 {
        let of = |side: Option<u8>| usize::from(side.unwrap_or(0));
        let across = self.across[of(before.map(|extent| extent.across))].bits(usize::from(after.across));
        let context = of(before.map(|extent| extent.down)) * POWERS + usize::from(after.across);
        across + self.down[context].bits(usize::from(after.down))
    }
}

impl<const SYMBOLS: usize> Model<SYMBOLS> {
    const NEW: Self = Self { counts: [0; SYMBOLS], total: 0 };

    /// Returns the bits of a symbol, and counts it.
    fn bits(&mut self, symbol: usize) -> f64 {
        let share = (f64::from(self.counts[symbol]) + 0.5) / (f64::from(self.total) + SYMBOLS as f64 / 2.0);
        self.counts[symbol] += 1;
        self.total += 1;
        -libm::log2(share)
    }
}

/// Returns the bits of a number: its length by the model, and its bits below the first.
fn number(model: &mut Model<LENGTHS>, value: u32) -> f64 {
    let length = 32 - value.leading_zeros();
    model.bits(length as usize) + f64::from(length.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(patches: impl Iterator<Item = u32>) -> Changes {
        let extent = Extent { across: 2, down: 3 };
        patches.map(|patch| (Patch(patch), [None, Some(extent)])).collect()
    }

    #[test]
    fn nothing_costs_nothing() {
        assert_eq!(PlacementCost::new().bytes(&Changes::new()), 0);
    }

    #[test]
    fn what_repeats_becomes_cheap() {
        let mut cost = PlacementCost::new();
        let (first, later) = (cost.bytes(&placed(0..64)), cost.bytes(&placed(64..128)));
        assert!(later < first && first < 64 * 2, "{first}, {later}");
        assert!(later <= 8, "neighbours of one size: {later}");
    }

    #[test]
    fn a_far_patch_costs_the_bits_of_its_distance() {
        let mut near = PlacementCost::new();
        let mut far = PlacementCost::new();
        let (near, far) = (near.bytes(&placed([3].into_iter())), far.bytes(&placed([1 << 30].into_iter())));
        assert!(far >= near + 3, "{near}, {far}");
    }

    #[test]
    fn a_block_that_goes_needs_no_extent() {
        let changes = |after: Option<Extent>| -> Changes {
            let before = Extent { across: 2, down: 2 };
            (0..200).map(|patch| (Patch(patch * 3), [Some(before), after])).collect()
        };
        let gone = PlacementCost::new().bytes(&changes(None));
        let larger = PlacementCost::new().bytes(&changes(Some(Extent { across: 3, down: 2 })));
        assert!(gone < larger, "{gone}, {larger}");
    }
}
