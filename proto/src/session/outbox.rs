//! The frames that wait to be sent. Stale ones can be dropped.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::{FrameIndex, Numbering};

/// Position of a client in the stream once all queued bytes have arrived. The next frame may build on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct StreamPosition {
    /// Group and sequence of its last keyframe or update.
    pub(super) numbering: Numbering,
    /// That frame, or `None` while it needs a keyframe.
    pub(super) holds: Option<FrameIndex>,
    /// Set once a frame without coder context was sent. The client can then no longer decode the shared updates.
    pub(super) context_lost: bool,
}

/// Frames that wait, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox {
    frames: VecDeque<Frame>,
    /// Bytes of the first frame that were sent already.
    taken: usize,
    /// Bytes that wait.
    bytes: usize,
}

/// Whether a frame that waits may be dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DropPolicy {
    /// The frame is always sent.
    Keep,
    /// The frame may be dropped, because a later one replaces it.
    Droppable,
    /// The frame is a keyframe or update and may be dropped. The client then stays at this position.
    State(StreamPosition),
}

#[derive(Clone, Debug)]
struct Frame {
    head: Vec<u8>,
    /// The payload, where it is shared and not part of `head`.
    body: Option<Arc<[u8]>>,
    policy: DropPolicy,
}

impl Frame {
    fn len(&self) -> usize {
        self.head.len() + self.body.as_ref().map_or(0, |body| body.len())
    }
}

impl Outbox {
    pub(super) fn push(&mut self, head: Vec<u8>, body: Option<Arc<[u8]>>, policy: DropPolicy) {
        let frame = Frame { head, body, policy };
        self.bytes += frame.len();
        self.frames.push_back(frame);
    }

    /// Returns the number of bytes that wait.
    pub(super) const fn len(&self) -> usize {
        self.bytes
    }

    pub(super) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Returns the next bytes of the first frame; empty only if none wait.
    pub(super) fn front(&self) -> &[u8] {
        let Some(frame) = self.frames.front() else { return &[] };
        match (frame.head.get(self.taken..), &frame.body) {
            (Some(head), _) if !head.is_empty() => head,
            (_, Some(body)) => body.get(self.taken - frame.head.len()..).unwrap_or_default(),
            (_, None) => &[],
        }
    }

    /// Marks `count` bytes of [`front`](Self::front) as sent.
    pub(super) fn advance(&mut self, count: usize) {
        let count = count.min(self.front().len());
        self.bytes -= count;
        self.taken += count;
        if self.frames.front().is_some_and(|frame| self.taken >= frame.len()) {
            self.frames.pop_front();
            self.taken = 0;
        }
    }

    /// Returns all bytes that wait, and marks them as sent.
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

    /// Drops the droppable frames of which no byte was sent yet. Returns their number, and the client's position
    /// without them if a keyframe or update was among them. With `keep_first` the first frame always stays: once it is
    /// taken, the other end takes bytes again.
    pub(super) fn drop_stale(&mut self, keep_first: bool) -> (u64, Option<StreamPosition>) {
        let before = self.frames.len();
        let begun = usize::from(keep_first || self.taken > 0);
        let mut back_to = None;
        let mut number = 0;
        self.frames.retain(|frame| {
            number += 1;
            if number <= begun || frame.policy == DropPolicy::Keep {
                return true;
            }
            if let DropPolicy::State(before) = frame.policy {
                back_to.get_or_insert(before);
            }
            false
        });
        self.bytes = self.frames.iter().map(Frame::len).sum::<usize>() - self.taken;
        ((before - self.frames.len()) as u64, back_to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stale_frames_go_but_never_one_that_was_begun() {
        let mut outbox = Outbox::default();
        let position = |frame| StreamPosition { holds: Some(FrameIndex(frame)), ..StreamPosition::default() };
        outbox.push(vec![1; 4], None, DropPolicy::State(position(1)));
        outbox.push(vec![2; 3], None, DropPolicy::Keep);
        outbox.push(vec![3; 1], Some([3].into()), DropPolicy::State(position(2)));
        outbox.push(vec![4; 1], None, DropPolicy::State(position(3)));
        outbox.push(vec![5; 1], None, DropPolicy::Droppable);
        outbox.advance(1);
        assert_eq!(outbox.len(), 10);
        assert_eq!(outbox.drop_stale(false), (3, Some(position(2))), "the first of those that went tells");
        assert_eq!(outbox.len(), 6);
        assert_eq!(outbox.take(), [1, 1, 1, 2, 2, 2]);
        assert_eq!((outbox.len(), outbox.is_empty()), (0, true));
        outbox.push(vec![4; 2], None, DropPolicy::Droppable);
        outbox.push(vec![5; 2], None, DropPolicy::Droppable);
        assert_eq!((outbox.drop_stale(true), outbox.len()), ((1, None), 2));
        assert_eq!((outbox.drop_stale(false), outbox.len()), ((1, None), 0));
        outbox.advance(5);
        assert_eq!(outbox.front(), b"");
    }

    #[test]
    fn a_shared_body_follows_its_head_in_any_pieces() {
        for step in 1..6 {
            let mut outbox = Outbox::default();
            outbox.push(vec![1, 2], Some([3, 4, 5].into()), DropPolicy::Keep);
            outbox.push(vec![6], Some([].into()), DropPolicy::Keep);
            let mut out = Vec::new();
            while !outbox.is_empty() {
                let count = outbox.front().len().min(step);
                assert!(count > 0);
                out.extend_from_slice(&outbox.front()[..count]);
                outbox.advance(count);
            }
            assert_eq!(out, [1, 2, 3, 4, 5, 6]);
        }
    }
}
