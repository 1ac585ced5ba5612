//! The history of every point: how it changed in earlier frames. The range coder predicts from it. The other coders
//! update it too, so that a stream may change between coders.

use crate::memory;
use crate::surface::{BLOCK_POINTS, PaddedIndex};

/// The history of all points, by padded index.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct History {
    /// Number of frames since the point changed, not counting the one in which it did. [`NEVER`] stands for any longer
    /// time.
    pub(crate) age: Vec<u8>,
    /// Number of frames between its last change and the one before, counted likewise.
    pub(crate) period: Vec<u8>,
    /// Level of its last change, within -127 to 127; 0 if it never changed.
    pub(crate) last: Vec<i8>,
    /// Activity at its last change, see [`History::faded_activity`].
    pub(crate) activity: Vec<u8>,
    /// Points that changed in the last frame, by block, one bit each: the points of age 0.
    pub(crate) recent: Vec<u64>,
    /// Points among them that became darker.
    pub(crate) darker: Vec<u64>,
    /// Blocks whose `recent` is not 0.
    recent_blocks: Vec<u32>,
}

/// An age or period of 255 frames or more, or a missing one.
pub(crate) const NEVER: u8 = 255;

/// Share of the activity that is left after a number of frames without a change: (3/4)^n in 256ths, rounded.
const FADE: [u16; 20] = [256, 192, 144, 108, 81, 61, 46, 34, 26, 19, 14, 11, 8, 6, 5, 3, 3, 2, 1, 1];

impl History {
    /// Creates the history of `blocks` blocks in which nothing has changed yet.
    pub(crate) fn new(blocks: usize) -> History {
        let padded = blocks * BLOCK_POINTS;
        History {
            recent: vec![0; blocks],
            darker: vec![0; blocks],
            recent_blocks: Vec::new(),
            age: vec![NEVER; padded],
            period: vec![NEVER; padded],
            last: vec![0; padded],
            activity: vec![0; padded],
        }
    }

    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        let History { age, period, last, activity, recent, darker, recent_blocks } = self;
        let bytes = memory::list(age) + memory::list(period) + memory::list(last) + memory::list(activity);
        bytes + memory::list(recent) + memory::list(darker) + memory::list(recent_blocks)
    }

    /// Creates a history from its parts, each by padded index and as long as whole blocks.
    pub(crate) fn from_parts(age: Vec<u8>, period: Vec<u8>, last: Vec<i8>, activity: Vec<u8>) -> History {
        let blocks = age.len() / BLOCK_POINTS;
        let (recent, darker) = (vec![0; blocks], vec![0; blocks]);
        let mut history = History { age, period, last, activity, recent, darker, recent_blocks: Vec::new() };
        for index in (0..history.age.len()).map(PaddedIndex) {
            if history.age[index.0] == 0 {
                history.mark_recent(index);
            }
        }
        history
    }

    fn clear_recent(&mut self) {
        for block in self.recent_blocks.drain(..) {
            self.recent[block as usize] = 0;
            self.darker[block as usize] = 0;
        }
    }

    /// Returns the faded activity: a mean of the sizes of the last changes, in 32nds of a quantum and at most 255. It
    /// fades by a quarter a frame.
    #[inline]
    pub(crate) fn faded_activity(&self, index: PaddedIndex) -> u8 {
        let fade = FADE.get(usize::from(self.age[index.0])).copied().unwrap_or(0);
        ((u32::from(self.activity[index.0]) * u32::from(fade)) >> 8) as u8
    }

    /// Returns the level of a point in the last frame; 0 if it did not change.
    #[inline]
    pub(crate) fn recent_level(&self, index: PaddedIndex) -> i8 {
        if self.age[index.0] == 0 { self.last[index.0] } else { 0 }
    }

    /// Advances all ages by a frame. The changes of that frame are recorded afterwards.
    pub(crate) fn advance(&mut self) {
        self.age.iter_mut().for_each(|age| *age = age.saturating_add(1));
        self.clear_recent();
    }

    /// Records that a point changed by `level` quanta in the newest frame.
    #[inline]
    pub(crate) fn record(&mut self, index: PaddedIndex, level: i16) {
        let waited = self.age[index.0].saturating_sub(1);
        let before = if self.age[index.0] == NEVER { NEVER } else { waited };
        let fade = FADE.get(usize::from(before)).copied().unwrap_or(0);
        let left = (u32::from(self.activity[index.0]) * u32::from(fade)) >> 8;
        let size = (u32::from(level.unsigned_abs()) * 32).min(255);
        self.activity[index.0] = ((3 * left + size + 2) / 4) as u8;
        self.period[index.0] = before;
        self.age[index.0] = 0;
        self.last[index.0] = level.clamp(-127, 127) as i8;
        self.mark_recent(index);
    }

    /// Marks a point of age 0 in the masks.
    fn mark_recent(&mut self, index: PaddedIndex) {
        let (block, bit) = (index.block(), index.bit());
        if self.recent[block] == 0 {
            self.recent_blocks.push(block as u32);
        }
        self.recent[block] |= bit;
        if self.last[index.0] < 0 {
            self.darker[block] |= bit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: PaddedIndex = PaddedIndex(0);

    #[test]
    fn ages_count_the_frames_between_changes() {
        let mut history = History::new(1);
        assert_eq!(
            (history.age[0], history.recent_level(POINT), history.faded_activity(POINT)),
            (NEVER, 0, 0)
        );
        history.advance();
        history.record(POINT, -3);
        assert_eq!((history.age[0], history.period[0], history.recent_level(POINT)), (0, NEVER, -3));
        assert_eq!((history.recent[0], history.darker[0]), (1, 1));
        for _ in 0..5 {
            history.advance();
        }
        assert_eq!((history.age[0], history.recent_level(POINT)), (5, 0));
        assert_eq!((history.recent[0], history.darker[0]), (0, 0));
        history.advance();
        history.record(POINT, 300);
        // Five frames lay between the two changes.
        assert_eq!((history.age[0], history.period[0], history.recent_level(POINT)), (0, 5, 127));
        assert_eq!(history.age[1], NEVER);
        for _ in 0..400 {
            history.advance();
        }
        assert_eq!(history.age[0], NEVER);
        history.record(POINT, 1);
        assert_eq!((history.age[0], history.period[0]), (0, NEVER));
    }

    #[test]
    fn liveliness_grows_with_change_and_fades_without() {
        let mut history = History::new(1);
        let mut before = 0;
        for _ in 0..6 {
            history.advance();
            history.record(POINT, 4);
            assert!(history.faded_activity(POINT) > before);
            before = history.faded_activity(POINT);
        }
        for _ in 0..20 {
            history.advance();
            assert!(history.faded_activity(POINT) <= before);
            before = history.faded_activity(POINT);
        }
        assert_eq!(before, 0);
    }
}
