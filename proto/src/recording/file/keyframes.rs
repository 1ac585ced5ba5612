//! When a recording gets a keyframe in place of an update.

use crate::{FrameType, Micros};

/// When a recording gets a keyframe in place of an update, besides where one ends a gap.
///
/// Players start at keyframes, and what damage costs ends at the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum KeyframeInterval {
    /// Never.
    Never,
    /// When this much time has passed since the last one.
    Every(Micros),
    /// When this much time has passed, and the frames since the last one take four times its bytes. So keyframes are at
    /// about a fifth of the recording at most, besides the first.
    Cheap(Micros),
}

impl Default for KeyframeInterval {
    fn default() -> Self {
        Self::Cheap(Micros::from_secs(5))
    }
}

/// Bytes of frames for each byte of a keyframe in [`KeyframeInterval::Cheap`].
const CHEAP_RATIO: u64 = 4;

/// The keyframes of a recording so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeyframeTimer {
    interval: KeyframeInterval,
    /// Arrival and bytes of the last one.
    last: Option<(Micros, u64)>,
    /// Bytes of the frames since.
    since: u64,
}

impl KeyframeTimer {
    pub(super) fn new(interval: KeyframeInterval) -> Self {
        Self { interval, last: None, since: 0 }
    }

    /// Takes a frame that is recorded.
    pub(super) fn took(&mut self, arrival: Micros, kind: FrameType, bytes: u64) {
        if kind == FrameType::KEYFRAME {
            (self.last, self.since) = (Some((arrival, bytes)), 0);
        } else {
            self.since += bytes;
        }
    }

    /// Returns the bytes of the last keyframe, if a frame that arrives now should be another one.
    pub(super) fn due(&self, arrival: Micros) -> Option<u64> {
        let (last, bytes) = self.last?;
        let passed = |interval| arrival.since(last) >= interval;
        let is_due = match self.interval {
            KeyframeInterval::Never => false,
            KeyframeInterval::Every(interval) => passed(interval),
            KeyframeInterval::Cheap(interval) => passed(interval) && self.since / CHEAP_RATIO >= bytes,
        };
        is_due.then_some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the turns at which a keyframe of 100 bytes is due, among updates of 10 bytes a second apart.
    fn due(interval: KeyframeInterval) -> Vec<u64> {
        let mut timer = KeyframeTimer::new(interval);
        assert!(timer.due(Micros::from_secs(1000)).is_none(), "a recording begins with the stream's own");
        timer.took(Micros(0), FrameType::KEYFRAME, 100);
        let mut found = Vec::new();
        for second in 1..100 {
            let now = Micros::from_secs(second);
            if timer.due(now).is_some() {
                timer.took(now, FrameType::KEYFRAME, 100);
                found.push(second);
            } else {
                timer.took(now, FrameType::UPDATE, 10);
            }
        }
        found
    }

    #[test]
    fn keyframes_are_due_by_time_or_by_what_they_cost() {
        let [seven, sixty] = [7, 60].map(Micros::from_secs);
        assert_eq!(due(KeyframeInterval::Never), []);
        assert_eq!(due(KeyframeInterval::Every(seven))[..3], [7, 14, 21]);
        assert_eq!(due(KeyframeInterval::Cheap(seven)), [41, 82], "after 400 bytes");
        assert_eq!(due(KeyframeInterval::Cheap(sixty)), [60]);
    }
}
