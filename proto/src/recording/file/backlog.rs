//! The queue of frames for the disk, and the rules for dropping frames. It uses no threads and no files.

use std::collections::VecDeque;

use crate::message::{Gap, GapReason, Message as _};
use crate::{FrameIndex, FrameType, HEADER_BYTES, Limits, Micros, Numbering};

/// Bytes by which messages may exceed the limit. Scene tables, edits and CLOSE are small, and no later frame replaces
/// them.
const MESSAGE_HEADROOM_BYTES: usize = 4 << 20;
/// Pause after a failed write before the next attempt.
const RETRY_DELAY: Micros = Micros::from_secs(1);

/// A frame to write.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BacklogItem {
    pub(super) arrival: Micros,
    pub(super) frame: Vec<u8>,
}

impl BacklogItem {
    fn kind(&self) -> FrameType {
        kind(&self.frame)
    }
}

/// Returns the type of a wire frame.
pub(super) fn kind(frame: &[u8]) -> FrameType {
    FrameType(frame.get(2).copied().unwrap_or_default())
}

/// Sums over the gaps of a recording, which arise when the disk is too slow or fails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GapTotals {
    /// Number of gaps.
    pub gaps: u64,
    /// Keyframes and updates missing.
    pub frames: u64,
    /// Bytes of all missing frames on the wire.
    pub bytes: u64,
}

/// The queue between a stream and a disk.
///
/// A frame that does not fit is dropped, and so is every later frame until a keyframe fits. This is a gap. A GAP
/// message before that keyframe describes it.
#[derive(Debug)]
pub(super) struct Backlog {
    limit: usize,
    limits: Limits,
    queue: VecDeque<BacklogItem>,
    /// Bytes in the queue and of the frame that is being written.
    bytes: usize,
    gap: Option<Gap>,
    /// Totals of the gaps that have ended.
    missing: GapTotals,
    /// Time of the next attempt after a failed write; `None` while the disk works.
    retry_at: Option<Micros>,
    ended: bool,
}

impl Backlog {
    /// Creates an empty queue of at most `limit` bytes. A longer frame is taken when the queue is empty.
    pub(super) fn new(limit: usize, limits: Limits) -> Self {
        let missing = GapTotals::default();
        Self {
            limit,
            limits,
            queue: VecDeque::new(),
            bytes: 0,
            gap: None,
            missing,
            retry_at: None,
            ended: false,
        }
    }

    /// Queues a frame, or drops it. Returns whether it was queued.
    pub(super) fn offer(&mut self, arrival: Micros, frame: &[u8]) -> bool {
        let taken = match kind(frame) {
            FrameType::KEYFRAME if self.gap.is_some() => self.may_retry(arrival) && self.fits(frame.len()),
            FrameType::UPDATE | FrameType::REPORT if self.gap.is_some() => false,
            FrameType::KEYFRAME | FrameType::UPDATE | FrameType::REPORT => self.fits(frame.len()),
            _ => self.bytes + frame.len() <= self.limit + MESSAGE_HEADROOM_BYTES,
        };
        if !taken {
            self.count_missing(
                frame,
                if self.retry_at.is_some() { GapReason::FAILED } else { GapReason::SLOW },
            );
            return false;
        }
        if kind(frame) == FrameType::KEYFRAME {
            self.retry_at = None;
            self.end_gap(arrival);
        }
        self.push(BacklogItem { arrival, frame: frame.to_vec() });
        true
    }

    /// Returns whether a keyframe would end a gap now, because half of the room is free. Without a gap, returns whether
    /// there is room for one of `due` bytes and a quarter more.
    pub(super) fn wants_keyframe(&self, now: Micros, due: Option<u64>) -> bool {
        if self.gap.is_some() {
            return self.may_retry(now) && self.bytes <= self.limit / 2;
        }
        due.is_some_and(|due| self.bytes as u64 + due + due / 4 <= self.limit as u64)
    }

    /// Returns the next frame to write; `None` during the pause after a failed write.
    pub(super) fn pop(&mut self) -> Option<BacklogItem> {
        if self.retry_at.is_some() && !self.ended { None } else { self.queue.pop_front() }
    }

    /// Frees the bytes of an item that was written.
    pub(super) fn wrote(&mut self, item: &BacklogItem) {
        self.bytes -= item.frame.len();
    }

    /// Handles a failed write. Queued frames are dropped; messages are kept for the next attempt, which comes after
    /// [`RETRY_DELAY`] or, with `for_good`, never.
    pub(super) fn failed(&mut self, item: Option<BacklogItem>, now: Micros, for_good: bool) {
        self.retry_at = Some(if for_good { Micros(u64::MAX) } else { now.plus(RETRY_DELAY) });
        let waiting: Vec<BacklogItem> = item.into_iter().chain(std::mem::take(&mut self.queue)).collect();
        for item in waiting {
            match item.kind() {
                FrameType::GAP => {
                    self.bytes -= item.frame.len();
                    self.reopen_gap(&item.frame);
                }
                kind if self.ended || kind.carries_state() || kind == FrameType::REPORT => {
                    self.bytes -= item.frame.len();
                    self.count_missing(&item.frame, GapReason::FAILED);
                }
                _ => self.queue.push_back(item),
            }
        }
        if let Some(gap) = &mut self.gap {
            gap.reason = GapReason::FAILED;
        }
    }

    /// Ends the stream. A GAP marks frames that are missing at its end.
    pub(super) fn end(&mut self, now: Micros) {
        self.ended = true;
        self.end_gap(now);
    }

    /// Returns whether the stream has ended.
    pub(super) const fn has_ended(&self) -> bool {
        self.ended
    }

    /// Returns the totals of all gaps so far, including the current one.
    pub(super) fn missing(&self) -> GapTotals {
        let mut missing = self.missing;
        if let Some(gap) = &self.gap {
            missing.gaps += 1;
            missing.frames += u64::from(gap.frames);
            missing.bytes += gap.bytes;
        }
        missing
    }

    /// Returns whether the disk works, or may be tried again after it failed.
    fn may_retry(&self, now: Micros) -> bool {
        self.retry_at.is_none_or(|retry| now >= retry)
    }

    fn fits(&self, length: usize) -> bool {
        self.bytes == 0 || self.bytes + length <= self.limit
    }

    fn push(&mut self, item: BacklogItem) {
        self.bytes += item.frame.len();
        self.queue.push_back(item);
    }

    /// Counts a dropped frame.
    fn count_missing(&mut self, frame: &[u8], reason: GapReason) {
        let number = kind(frame).carries_state().then(|| {
            let body = frame.get(HEADER_BYTES..).unwrap_or_default();
            psao_codec::envelope::inspect(body, &self.limits.codec).map_or(FrameIndex(0), |info| info.frame)
        });
        let none = Gap {
            first_lost: number.unwrap_or_default(),
            last_lost: number.unwrap_or_default(),
            frames: 0,
            bytes: 0,
            reason,
        };
        let gap = self.gap.get_or_insert(none);
        gap.bytes += frame.len() as u64;
        if let Some(number) = number {
            if gap.frames == 0 {
                gap.first_lost = number;
            }
            gap.last_lost = number;
            gap.frames += 1;
        }
    }

    /// Ends the current gap and queues its GAP message.
    fn end_gap(&mut self, arrival: Micros) {
        let Some(gap) = self.gap.take() else { return };
        self.missing.gaps += 1;
        self.missing.frames += u64::from(gap.frames);
        self.missing.bytes += gap.bytes;
        if let Ok(frame) = Numbering::default().message(&gap) {
            self.push(BacklogItem { arrival, frame });
        }
    }

    /// Merges a GAP message that could not be written into the current gap.
    fn reopen_gap(&mut self, frame: &[u8]) {
        let Ok(mark) = Gap::from_payload(frame.get(HEADER_BYTES..).unwrap_or_default()) else { return };
        self.missing.gaps -= 1;
        self.missing.frames -= u64::from(mark.frames);
        self.missing.bytes -= mark.bytes;
        self.gap = Some(match self.gap.take() {
            None => mark,
            Some(gap) => Gap {
                first_lost: if mark.frames > 0 { mark.first_lost } else { gap.first_lost },
                last_lost: if gap.frames > 0 { gap.last_lost } else { mark.last_lost },
                frames: mark.frames + gap.frames,
                bytes: mark.bytes + gap.bytes,
                reason: gap.reason,
            },
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::SampleServer;
    use proptest::prelude::*;

    /// A stream that makes keyframes on request.
    struct Stream {
        server: SampleServer,
        numbering: Numbering,
    }

    impl Stream {
        fn new() -> Self {
            Self { server: SampleServer::new().unwrap(), numbering: Numbering::default() }
        }

        fn next(&mut self, key: bool) -> Vec<u8> {
            let first = self.server.state().frame().is_none();
            let body = self.server.step().unwrap().body;
            match (first, key) {
                (true, _) => self.numbering.keyframe(&body),
                (false, true) => self.numbering.keyframe(&self.server.keyframe().unwrap()),
                (false, false) => self.numbering.update(&body),
            }
            .unwrap()
        }
    }

    fn gap_of(item: &BacklogItem) -> Gap {
        Gap::from_payload(&item.frame[HEADER_BYTES..]).unwrap()
    }

    fn drain(backlog: &mut Backlog) -> Vec<BacklogItem> {
        std::iter::from_fn(|| {
            let item = backlog.pop()?;
            backlog.wrote(&item);
            Some(item)
        })
        .collect()
    }

    #[test]
    fn a_slow_disk_costs_frames_up_to_the_next_keyframe_that_fits() {
        let mut stream = Stream::new();
        let first = stream.next(true);
        let mut backlog = Backlog::new(first.len() + 10, Limits::default());
        assert!(backlog.offer(Micros(0), &first));
        // The frame is being written, so it still takes room.
        let item = backlog.pop().unwrap();
        assert!(backlog.wants_keyframe(Micros(1), Some(4)) && !backlog.wants_keyframe(Micros(1), Some(9)));
        assert!(!backlog.offer(Micros(1), &stream.next(false)));
        assert!(!backlog.wants_keyframe(Micros(1), Some(1)), "there is no room for one");
        assert!(!backlog.offer(Micros(2), &stream.next(true)), "nor is it taken");
        backlog.wrote(&item);
        assert!(backlog.wants_keyframe(Micros(3), None));
        assert!(!backlog.offer(Micros(3), &stream.next(false)), "an update has nothing to build on");
        let close = crate::message::Close::new(crate::message::CloseCode::DONE, "");
        assert!(backlog.offer(Micros(3), &stream.numbering.message(&close).unwrap()), "messages stay");
        assert_eq!(drain(&mut backlog).len(), 1);
        assert!(backlog.offer(Micros(4), &stream.next(true)));
        assert!(!backlog.wants_keyframe(Micros(4), None));
        let items = drain(&mut backlog);
        assert_eq!(
            items.iter().map(BacklogItem::kind).collect::<Vec<_>>(),
            [FrameType::GAP, FrameType::KEYFRAME]
        );
        let gap = gap_of(&items[0]);
        assert_eq!((gap.first_lost, gap.last_lost, gap.frames), (FrameIndex(1), FrameIndex(3), 3));
        assert_eq!((gap.reason, gap.bytes), (GapReason::SLOW, backlog.missing().bytes));
        assert_eq!((backlog.missing().gaps, backlog.missing().frames), (1, 3));
    }

    #[test]
    fn a_disk_that_failed_is_tried_again_with_a_keyframe_and_keeps_its_messages() {
        let mut stream = Stream::new();
        let mut backlog = Backlog::new(1 << 20, Limits::default());
        let scene = stream.numbering.scene(stream.server.scene()).unwrap();
        for frame in &scene {
            assert!(backlog.offer(Micros(0), frame));
        }
        let failing = backlog.pop().unwrap();
        assert!(backlog.offer(Micros(0), &stream.next(true)));
        assert!(backlog.offer(Micros(1), &stream.next(false)));
        backlog.failed(Some(failing), Micros(5), false);
        assert_eq!(backlog.pop(), None, "the disk is left alone");
        let almost = Micros(5).plus(RETRY_DELAY).since(Micros(1));
        assert!(!backlog.wants_keyframe(almost, None) && !backlog.offer(almost, &stream.next(true)));
        let then = Micros(5).plus(RETRY_DELAY);
        assert!(backlog.wants_keyframe(then, None) && backlog.offer(then, &stream.next(true)));
        // The disk fails again: the GAP message is merged back, and losses add up.
        let failing = backlog.pop();
        backlog.failed(failing, then, false);
        let later = then.plus(RETRY_DELAY);
        assert!(backlog.offer(later, &stream.next(true)));
        assert!(backlog.offer(later, &stream.next(false)));
        let items = drain(&mut backlog);
        assert_eq!(
            items[..scene.len()].iter().map(|item| &item.frame).collect::<Vec<_>>(),
            scene.iter().collect::<Vec<_>>()
        );
        let kinds: Vec<_> = items[scene.len()..].iter().map(BacklogItem::kind).collect();
        assert_eq!(kinds, [FrameType::GAP, FrameType::KEYFRAME, FrameType::UPDATE]);
        let gap = gap_of(&items[scene.len()]);
        assert_eq!((gap.first_lost, gap.last_lost, gap.frames), (FrameIndex(0), FrameIndex(3), 4));
        assert_eq!((gap.reason, backlog.missing().gaps), (GapReason::FAILED, 1));
        assert_eq!(backlog.bytes, 0);
    }

    #[test]
    fn a_file_that_is_gone_is_not_tried_again() {
        let mut stream = Stream::new();
        let mut backlog = Backlog::new(1 << 20, Limits::default());
        backlog.offer(Micros(0), &stream.next(true));
        backlog.failed(None, Micros(1), true);
        for second in 0..100 {
            let now = Micros::from_secs(second * 1000);
            assert!(!backlog.wants_keyframe(now, None) && !backlog.offer(now, &stream.next(true)));
        }
        assert_eq!(backlog.missing().frames, 101);
    }

    proptest! {
        /// Whatever the disk does, each frame is written or counted, each gap has its mark, and the bound holds.
        #[test]
        fn every_frame_is_written_or_counted(
            limit in 300usize..3000, turns in prop::collection::vec((0u8..10, any::<bool>()), 1..120),
        ) {
            let mut stream = Stream::new();
            let mut backlog = Backlog::new(limit, Limits::default());
            let (mut offered, mut written, mut at_disk) = (0u64, Vec::new(), None::<BacklogItem>);
            for (now, &(turn, key)) in (0..).map(Micros::from_secs).zip(&turns) {
                match turn {
                    0..5 => {
                        offered += 1;
                        let key = key || backlog.wants_keyframe(now, None);
                        let frame = stream.next(key);
                        let before = backlog.bytes;
                        if backlog.offer(now, &frame) {
                            // A GAP message may precede the frame.
                            prop_assert!(before == 0 || backlog.bytes <= limit + 60);
                        }
                    }
                    5..7 => at_disk = at_disk.take().or_else(|| backlog.pop()),
                    7..9 => if let Some(item) = at_disk.take() {
                        backlog.wrote(&item);
                        written.push(item);
                    },
                    _ => if let Some(item) = at_disk.take() {
                        backlog.failed(Some(item), now, false);
                    },
                }
            }
            backlog.end(Micros(0));
            if let Some(item) = at_disk {
                backlog.wrote(&item);
                written.push(item);
            }
            written.extend(drain(&mut backlog));
            prop_assert_eq!(backlog.bytes, 0);
            let frames = written.iter().filter(|item| item.kind().carries_state()).count() as u64;
            let missing = backlog.missing();
            prop_assert_eq!(frames + missing.frames, offered);
            let prerequisites: Vec<Gap> = written.iter().filter(|i| i.kind() == FrameType::GAP).map(gap_of).collect();
            prop_assert_eq!(prerequisites.len() as u64, missing.gaps);
            prop_assert_eq!(prerequisites.iter().map(|gap| u64::from(gap.frames)).sum::<u64>(), missing.frames);
            for pair in written.windows(2) {
                let after_gap = pair[0].kind() == FrameType::GAP;
                // If the keyframe itself failed, another gap follows.
                prop_assert!(!after_gap || pair[1].kind() != FrameType::UPDATE);
            }
        }
    }
}
