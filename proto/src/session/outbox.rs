//! The bytes that wait to be sent, as whole frames, so that those nobody needs any more can be dropped.

use std::collections::VecDeque;

/// Frames that wait, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox {
    frames: VecDeque<Frame>,
    /// Bytes of the first frame that were taken already.
    taken: usize,
    /// Bytes that wait.
    bytes: usize,
}

#[derive(Clone, Debug)]
struct Frame {
    bytes: Vec<u8>,
    /// Whether a later keyframe makes it superfluous.
    droppable: bool,
}

impl Outbox {
    pub(super) fn push(&mut self, bytes: Vec<u8>, droppable: bool) {
        self.bytes += bytes.len();
        self.frames.push_back(Frame { bytes, droppable });
    }

    /// Bytes that wait.
    pub(super) const fn len(&self) -> usize {
        self.bytes
    }

    pub(super) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// The rest of the first frame.
    pub(super) fn front(&self) -> &[u8] {
        self.frames.front().and_then(|frame| frame.bytes.get(self.taken..)).unwrap_or_default()
    }

    /// Marks `count` bytes of [`front`](Self::front) as sent.
    pub(super) fn advance(&mut self, count: usize) {
        let count = count.min(self.front().len());
        self.bytes -= count;
        self.taken += count;
        if self.front().is_empty() {
            self.frames.pop_front();
            self.taken = 0;
        }
    }

    /// Everything that waits.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.bytes);
        while !self.is_empty() {
            let front = self.front();
            let count = front.len();
            out.extend_from_slice(front);
            self.advance(count);
        }
        out
    }

    /// Drops the droppable frames of which nothing was sent yet, and says how many. With `keep_first` the first frame
    /// stays in any case: that it is taken later shows that the other end takes bytes again.
    pub(super) fn drop_stale(&mut self, keep_first: bool) -> u64 {
        let before = self.frames.len();
        let begun = usize::from(keep_first || self.taken > 0);
        let mut place = 0;
        self.frames.retain(|frame| {
            place += 1;
            place <= begun || !frame.droppable
        });
        self.bytes = self.frames.iter().map(|frame| frame.bytes.len()).sum::<usize>() - self.taken;
        (before - self.frames.len()) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stale_frames_go_but_never_one_that_was_begun() {
        let mut outbox = Outbox::default();
        outbox.push(vec![1; 4], true);
        outbox.push(vec![2; 3], false);
        outbox.push(vec![3; 2], true);
        outbox.advance(1);
        assert_eq!(outbox.len(), 8);
        assert_eq!(outbox.drop_stale(false), 1);
        assert_eq!(outbox.len(), 6);
        assert_eq!(outbox.take(), [1, 1, 1, 2, 2, 2]);
        assert_eq!((outbox.len(), outbox.is_empty()), (0, true));
        outbox.push(vec![4; 2], true);
        outbox.push(vec![5; 2], true);
        assert_eq!((outbox.drop_stale(true), outbox.len()), (1, 2));
        assert_eq!((outbox.drop_stale(false), outbox.len()), (1, 0));
        outbox.advance(5);
        assert_eq!(outbox.front(), b"");
    }
}
