//! Which point changed in which frame, so that a client that missed some can be told what it missed and nothing else.

use std::sync::Arc;

use super::{BLOCK_POINTS, Layout, State};
use crate::envelope::FrameIndex;

/// What a server remembers of the frames that it has sent, for all clients together: 5 B a point.
///
/// Clients take the newest value of what they missed ([`super::patch`]), so however far one falls behind, it is owed no
/// more than a value for every point.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeLog {
    layout: Arc<Layout>,
    /// The last frame seen; `None` before the first.
    frame: Option<FrameIndex>,
    /// The last frame that brought blocks or geometry, or took them away; of earlier ones nothing is known.
    since: FrameIndex,
    values: Vec<u8>,
    present: Vec<bool>,
    received: Vec<bool>,
    /// By slot: the frame in which the point changed last, or 0.
    changed: Vec<u32>,
    /// By block: the newest of these.
    newest: Vec<u32>,
}

impl ChangeLog {
    /// A change log that begins with `state`: of the frames before it knows nothing.
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
        }
    }

    /// Notes what the last frame changed; `state` is the one after it.
    ///
    /// To be called after every frame: of a point that changes and changes back between two calls it sees nothing. A state
    /// of another layout, or one that is not after the last, makes it begin anew.
    pub fn record(&mut self, state: &State) {
        let same_layout = Arc::ptr_eq(&self.layout, &state.layout) || self.layout == state.layout;
        if !same_layout || state.frame < self.frame {
            *self = ChangeLog::new(state);
            return;
        }
        let again = state.frame == self.frame;
        let Some(frame) = state.frame else { return };
        let mut differs = self.present != state.present || self.received != state.received;
        if differs || self.frame.is_none() {
            self.since = frame;
            self.present.clone_from(&state.present);
            self.received.clone_from(&state.received);
        }
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
            // Clients of the same frame do not all hold the same: none of them can be told what it missed.
            *self = ChangeLog::new(state);
        }
    }

    /// The last frame seen; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        self.frame
    }

    /// The points that changed after frame `base`, as blocks and their points, one bit each; blocks ascend.
    ///
    /// `None` when it cannot be said: blocks or geometry came or went after `base`, it is before the change log's beginning, or no
    /// frame that it has seen. Only a keyframe helps a client of that frame.
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
}
