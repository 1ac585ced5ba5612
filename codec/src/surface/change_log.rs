//! The change log tells which point changed in which frame, so that a patch holds only what a client missed.

use std::sync::Arc;

use bitvec::vec::BitVec;

use super::{BLOCK_POINTS, Layout, State};
use crate::envelope::FrameIndex;

/// The last frame in which each point changed or arrived, for all clients together: 5 B a point.
///
/// Clients take the newest value of what they missed ([`super::patch`]). So however far a client falls behind, it
/// needs at most one value for every point.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeLog {
    layout: Arc<Layout>,
    /// The last frame recorded; `None` before the first.
    frame: Option<FrameIndex>,
    /// The last frame in which geometry arrived, or blocks or geometry left. Nothing is known of earlier frames.
    since: FrameIndex,
    values: Vec<u8>,
    present: Vec<bool>,
    received: BitVec,
    /// By padded index: the frame in which the point changed last, or 0.
    changed: Vec<u32>,
    /// By block: the newest of these frames.
    newest: Vec<u32>,
    /// By block: the frame in which it arrived, or 0.
    arrived: Vec<u32>,
}

impl ChangeLog {
    /// Creates a change log that begins with `state`. It knows nothing of earlier frames.
    #[must_use]
    pub fn new(state: &State) -> ChangeLog {
        ChangeLog {
            layout: Arc::clone(&state.layout),
            frame: state.frame,
            since: state.frame.unwrap_or_default(),
            values: state.values.clone(),
            present: state.present.clone(),
            received: state.received.clone(),
            changed: vec![0; state.values.len()],
            newest: vec![0; state.present.len()],
            arrived: vec![0; state.present.len()],
        }
    }

    /// Records what the last frame changed; `state` is the state after it.
    ///
    /// Call it after every frame: it does not notice a point that changes and changes back between two calls. The log
    /// starts anew for a state of another layout, or one that is older than the last.
    pub fn record(&mut self, state: &State) {
        let same_layout = Arc::ptr_eq(&self.layout, &state.layout) || self.layout == state.layout;
        if !same_layout || state.frame < self.frame {
            *self = ChangeLog::new(state);
            return;
        }
        let again = state.frame == self.frame;
        let Some(frame) = state.frame else { return };
        let mut differs = self.present != state.present || self.received != state.received;
        let left = self.present.iter().zip(&state.present).any(|(before, now)| *before && !now);
        if self.received != state.received || left || self.frame.is_none() {
            self.since = frame;
            self.received.clone_from(&state.received);
        }
        for block in 0..self.present.len() {
            if state.present[block] && !self.present[block] {
                (self.arrived[block], self.newest[block]) = (frame.0, frame.0);
                self.changed[block * BLOCK_POINTS..][..state.layout.block_len(block)].fill(frame.0);
            }
        }
        self.present.clone_from(&state.present);
        let blocks = self.values.chunks_exact_mut(BLOCK_POINTS).zip(state.values.chunks_exact(BLOCK_POINTS));
        for (block, (known, now)) in blocks.enumerate() {
            if known != now {
                differs = true;
                self.newest[block] = frame.0;
                let stamps = &mut self.changed[block * BLOCK_POINTS..][..BLOCK_POINTS];
                for (stamp, _) in stamps.iter_mut().zip(known.iter().zip(now)).filter(|(_, (a, b))| a != b) {
                    *stamp = frame.0;
                }
                known.copy_from_slice(now);
            }
        }
        self.frame = Some(frame);
        if again && differs {
            // Clients of this frame may hold different states: nothing is known of what they missed.
            *self = ChangeLog::new(state);
        }
    }

    /// Returns the last frame recorded; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        self.frame
    }

    /// Returns the points that changed or arrived after frame `base`: blocks, ascending, and the points of each, one bit
    /// each.
    ///
    /// Returns `None` if this is not known: geometry arrived after `base`, blocks or geometry left, or the log has not
    /// recorded that frame. Then only a keyframe helps.
    #[must_use]
    pub fn changed_since(&self, base: FrameIndex) -> Option<impl Iterator<Item = (u32, u64)> + '_> {
        if base < self.since || self.frame.is_none_or(|frame| base > frame) {
            return None;
        }
        let stamps = self.changed.chunks_exact(BLOCK_POINTS);
        let blocks = (0..).zip(&self.newest).zip(stamps).filter(move |((_, newest), _)| **newest > base.0);
        let mask = |stamps: &[u32], base: FrameIndex| {
            stamps.iter().rev().fold(0, |mask, stamp| mask << 1 | u64::from(*stamp > base.0))
        };
        Some(blocks.map(move |((block, _), stamps)| (block, mask(stamps, base))))
    }

    /// Returns the blocks that arrived after frame `base`, ascending.
    pub(super) fn arrived_since(&self, base: FrameIndex) -> impl Iterator<Item = u32> + '_ {
        (0..).zip(&self.arrived).filter(move |(_, frame)| **frame > base.0).map(|(block, _)| block)
    }
}
