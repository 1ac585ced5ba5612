//! The differences between the server's tables and the state of clients.

use super::cells::{DirtySet, Tables};
use super::{Bucket, Cell, Layout, Pose, Records, State};
use crate::StateHash;
use crate::hash::RecordKind;

/// New contents of poses, buckets and cells, each list in ascending order.
#[derive(Debug, Default)]
pub(super) struct TableChanges {
    poses: Vec<(u32, Pose)>,
    buckets: Vec<(u32, Bucket)>,
    cells: Vec<(u32, Cell)>,
}

impl TableChanges {
    /// Compares what was touched since the last frame. Freed cells stay as clients have them, because no bucket names
    /// them. The tables are compact.
    pub(super) fn from_dirty(
        sent: &State,
        poses: &[Pose],
        dirty_poses: &mut DirtySet,
        tables: &Tables,
    ) -> TableChanges {
        let mut changes = TableChanges::default();
        for instance in dirty_poses.sorted() {
            changes.compare_pose(*instance, &sent.poses[*instance as usize], poses[*instance as usize]);
        }
        let (dirty_buckets, dirty_cells) = tables.dirty();
        for index in dirty_buckets {
            changes.compare_bucket(*index, &sent.buckets[*index as usize], tables.bucket(*index));
        }
        for index in dirty_cells {
            if let Some(cell) = tables.cell(*index) {
                changes.compare_cell(*index, &sent.cells[*index as usize], cell);
            }
        }
        changes
    }

    /// Compares everything. Cells that are not in use become empty. The tables are compact.
    pub(super) fn from_all(sent: &State, poses: &[Pose], tables: &Tables) -> TableChanges {
        let mut changes = TableChanges::default();
        for ((instance, old), new) in (0_u32..).zip(&sent.poses).zip(poses) {
            changes.compare_pose(instance, old, *new);
        }
        for (index, old) in (0_u32..).zip(&sent.buckets) {
            changes.compare_bucket(index, old, tables.bucket(index));
        }
        for (index, old) in (0_u32..).zip(&sent.cells) {
            changes.compare_cell(index, old, tables.cell(index).unwrap_or_default());
        }
        changes
    }

    fn compare_pose(&mut self, instance: u32, old: &Pose, new: Pose) {
        // By words: -0 and 0 are equal, but their bytes differ.
        if old.to_words() != new.to_words() {
            self.poses.push((instance, new));
        }
    }

    fn compare_bucket(&mut self, index: u32, old: &Bucket, new: Bucket) {
        if *old != new {
            self.buckets.push((index, new));
        }
    }

    fn compare_cell(&mut self, index: u32, old: &Cell, new: Cell) {
        if *old != new {
            self.cells.push((index, new));
        }
    }

    /// Returns the hash of `sent` after these changes.
    pub(super) fn hash_after(&self, sent: &State) -> StateHash {
        let mut hash = sent.hash();
        for (index, new) in &self.poses {
            let old = sent.poses[*index as usize];
            hash = hash.replace(RecordKind::Pose, *index, &old.hash_words(), &new.hash_words());
        }
        for (index, new) in &self.buckets {
            let old = sent.buckets[*index as usize];
            hash = hash.replace(RecordKind::Bucket, *index, &old.to_words(), &new.to_words());
        }
        for (index, new) in &self.cells {
            let old = sent.cells[*index as usize];
            hash = hash.replace(RecordKind::Cell, *index, old.words(), new.words());
        }
        hash
    }

    /// Writes the records of a delta. A cell becomes its exclusive or with the cell sent last.
    pub(super) fn push_records(&self, records: &mut Records, sent: &State) {
        for (instance, pose) in &self.poses {
            records.push_pose(*instance, *pose);
        }
        for (index, bucket) in &self.buckets {
            records.push_bucket(*index, bucket);
        }
        for (index, cell) in &self.cells {
            records.push_cell(*index, &sent.cells[*index as usize].xor(cell.words()));
        }
    }

    /// Makes the changes. The caller sets the hash.
    pub(super) fn commit(&self, sent: &mut State) {
        for (instance, pose) in &self.poses {
            sent.poses[*instance as usize] = *pose;
        }
        for (index, bucket) in &self.buckets {
            sent.buckets[*index as usize] = *bucket;
        }
        for (index, cell) in &self.cells {
            sent.cells[*index as usize] = *cell;
        }
    }
}

/// Writes the records of a keyframe: everything in use.
pub(super) fn push_all_records(records: &mut Records, poses: &[Pose], tables: &Tables, layout: &Layout) {
    records.push_all(
        poses.iter().copied(),
        (0..layout.bucket_total()).map(|index| tables.bucket(index)),
        (0..layout.cell_capacity()).map(|index| tables.cell(index).unwrap_or_default()),
    );
}
