//! A cache of self hits for points near moving instances, within a limit of memory.

use crate::ao::{SelfHitCache, SelfHits};

/// A chunk is cleared after this many frames in which none of its points was traced: what passes by comes back soon or
/// not for a long time.
const FORGET_AFTER_FRAMES: u16 = 240;

/// Self hits of the points of a chunk.
#[derive(Debug, Default)]
pub(super) struct ChunkHitCache {
    /// By point; empty when nothing is cached.
    points: Vec<Option<Box<SelfHits>>>,
    /// Frames since a point was traced.
    idle: u16,
    bytes: usize,
}

impl ChunkHitCache {
    /// Returns the entry of a point in a chunk of `count` points. Empty entries are offered only with `keep`.
    pub(super) fn of(&mut self, point: usize, count: usize, keep: bool) -> SelfHitCache<'_> {
        if self.points.is_empty() {
            if !keep {
                return SelfHitCache::Off;
            }
            self.points.resize_with(count, || None);
        }
        self.idle = 0;
        match &mut self.points[point] {
            Some(known) => SelfHitCache::Filled(known),
            vacant if keep => SelfHitCache::Empty(vacant),
            _ => SelfHitCache::Off,
        }
    }

    /// Drops all entries.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Ends a frame: drops the entries of a chunk that was idle for long. Returns the bytes held on the heap.
    fn rest(&mut self) -> usize {
        if self.points.is_empty() {
            return 0;
        }
        if self.idle == 0 {
            let held = self.points.iter().flatten().map(|known| known.bytes()).sum::<usize>();
            self.bytes = held + size_of_val(&*self.points);
        }
        self.idle += 1;
        if self.idle > FORGET_AFTER_FRAMES {
            self.clear();
        }
        self.bytes
    }
}

/// Ends a frame for all chunks. Drops entries beyond `limit` bytes, the idlest chunks first. Returns the bytes held on the heap.
pub(super) fn settle(chunks: &mut [ChunkHitCache], limit: usize) -> usize {
    let mut bytes: usize = chunks.iter_mut().map(ChunkHitCache::rest).sum();
    if bytes > limit {
        let mut order: Vec<usize> = (0..chunks.len()).filter(|&chunk| chunks[chunk].bytes > 0).collect();
        order.sort_by_key(|&chunk| std::cmp::Reverse(chunks[chunk].idle));
        for chunk in order {
            if bytes <= limit {
                break;
            }
            bytes -= chunks[chunk].bytes;
            chunks[chunk].clear();
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn remember(memory: &mut ChunkHitCache, point: usize) {
        let SelfHitCache::Empty(slot) = memory.of(point, 8, true) else { panic!("there is room") };
        *slot = Some(Box::default());
    }

    #[test]
    fn what_is_of_no_use_for_long_is_forgotten() {
        let mut chunks = [ChunkHitCache::default(), ChunkHitCache::default()];
        chunks.iter_mut().for_each(|chunk| remember(chunk, 3));
        let both = settle(&mut chunks, usize::MAX);
        for _ in 0..FORGET_AFTER_FRAMES {
            assert!(matches!(chunks[0].of(3, 8, false), SelfHitCache::Filled(_)));
            assert!(matches!(chunks[0].of(4, 8, false), SelfHitCache::Off));
            settle(&mut chunks, usize::MAX);
        }
        assert_eq!(settle(&mut chunks, usize::MAX), both / 2);
        assert!(matches!(chunks[1].of(3, 8, false), SelfHitCache::Off));
    }

    #[test]
    fn the_limit_is_kept_by_forgetting_the_idlest() {
        let mut chunks = [ChunkHitCache::default(), ChunkHitCache::default()];
        chunks.iter_mut().for_each(|chunk| remember(chunk, 0));
        let both = settle(&mut chunks, usize::MAX);
        remember(&mut chunks[1], 1);
        let left = settle(&mut chunks, both);
        assert!(left > both / 2 && left <= both);
        assert!(matches!(chunks[0].of(0, 8, false), SelfHitCache::Off));
        assert!(matches!(chunks[1].of(1, 8, false), SelfHitCache::Filled(_)));
        assert_eq!(settle(&mut chunks, 0), 0);
    }
}
