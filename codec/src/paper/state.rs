//! The state of a client. The server keeps the same as "last sent".

use std::sync::Arc;

use super::{Bucket, Cell, Layout, Pose, bucket_of, cell_id};
use crate::envelope::FrameIndex;
use crate::hash::RecordKind;
use crate::{StateHash, memory};

/// The state of a stream: buckets, cells and poses, and the hash over all of them.
///
/// Only [`super::apply`] and the encoder change it, so that hash and content always agree.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    layout: Arc<Layout>,
    pub(crate) buckets: Vec<Bucket>,
    pub(crate) cells: Vec<Cell>,
    pub(crate) poses: Vec<Pose>,
    pub(crate) hash: StateHash,
    pub(crate) frame: Option<FrameIndex>,
}

impl State {
    /// Creates the empty state of a layout: no cells, identity poses, hash 0.
    ///
    /// It allocates 64 B a bucket, 28 B a cell and 28 B an instance. [`Layout::new`] has checked the sizes.
    #[must_use]
    pub fn new(layout: Arc<Layout>) -> State {
        let buckets = vec![Bucket::default(); layout.bucket_total() as usize];
        let cells = vec![Cell::default(); layout.cell_capacity() as usize];
        let poses = vec![Pose::IDENTITY; layout.instances().len()];
        State { layout, buckets, cells, poses, hash: StateHash::default(), frame: None }
    }

    /// Returns the heap bytes in use, including the layout.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.layout.heap_bytes()
            + memory::list(&self.buckets)
            + memory::list(&self.cells)
            + memory::list(&self.poses)
    }

    /// Returns the layout of the stream.
    #[must_use]
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// Returns the hash of buckets, cells and poses. Every frame updates it.
    #[must_use]
    pub fn hash(&self) -> StateHash {
        self.hash
    }

    /// Returns the last frame applied; `None` before the first.
    #[must_use]
    pub fn frame(&self) -> Option<FrameIndex> {
        self.frame
    }

    /// Returns all cells, in index order. Those that no bucket names hold stale points.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Returns all buckets, instance after instance.
    #[must_use]
    pub fn buckets(&self) -> &[Bucket] {
        &self.buckets
    }

    /// Returns the poses of all instances, in order.
    #[must_use]
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Returns the pose of an instance; `None` if there is no such instance.
    #[must_use]
    pub fn pose(&self, instance: u32) -> Option<&Pose> {
        self.poses.get(instance as usize)
    }

    /// Returns the cell of an instance (paper, section 3.5): it hashes the cell and searches its bucket for the raw
    /// id. `None` if there is no such instance or cell, or the cell has no point.
    #[inline]
    #[must_use]
    pub fn lookup(&self, instance: u32, cell: [u32; 3]) -> Option<&Cell> {
        let layout = self.layout.instances().get(instance as usize)?;
        let dims = layout.grid.dims();
        if (0..3).any(|axis| cell[axis] >= dims[axis]) {
            return None;
        }
        let id = cell_id(cell, dims);
        let bucket = layout.first_bucket + bucket_of(id, layout.bucket_count);
        let mut used =
            self.buckets.get(bucket as usize)?.entries().iter().take_while(|entry| entry.is_used());
        let entry = used.find(|entry| entry.id() == id)?;
        self.cells.get(entry.cell() as usize)
    }

    /// Computes the hash from scratch: the reference of [`State::hash`].
    #[must_use]
    pub fn full_hash(&self) -> StateHash {
        let mut hash = StateHash::default();
        for (index, pose) in (0_u32..).zip(&self.poses) {
            hash = hash.insert(RecordKind::Pose, index, &pose.hash_words());
        }
        for (index, bucket) in (0_u32..).zip(&self.buckets) {
            hash = hash.insert(RecordKind::Bucket, index, &bucket.to_words());
        }
        for (index, cell) in (0_u32..).zip(&self.cells) {
            hash = hash.insert(RecordKind::Cell, index, cell.words());
        }
        hash
    }

    /// Makes the state empty, in place.
    pub(crate) fn clear(&mut self) {
        self.buckets.fill(Bucket::default());
        self.cells.fill(Cell::default());
        self.poses.fill(Pose::IDENTITY);
        self.hash = StateHash::default();
        self.frame = None;
    }
}

#[cfg(test)]
mod tests {
    use crate::block::BlockCoder;
    use crate::testing::story;

    #[test]
    fn look_ups_outside_the_layout_find_nothing() {
        let state = story(BlockCoder::Stored).after_key;
        assert!(state.lookup(0, [0, 0, 0]).is_some());
        for cell in [[4, 0, 0], [0, 4, 0], [0, 0, 4], [u32::MAX; 3]] {
            assert!(state.lookup(0, cell).is_none(), "{cell:?}");
        }
        assert!(state.lookup(2, [0, 0, 0]).is_none());
        assert!(state.pose(2).is_none());
        assert_eq!(state.pose(1).map(|pose| pose.translation), Some([1.0, 2.0, 3.0]));
    }

    #[test]
    fn clearing_leaves_the_empty_state() {
        let story = story(BlockCoder::Stored);
        let mut state = story.after_delta;
        state.clear();
        assert_eq!(state, story.empty);
        assert_eq!(state.full_hash(), state.hash());
    }
}
