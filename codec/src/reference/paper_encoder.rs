//! The reference of [`crate::paper::Encoder`], without dirty lists, counters or an incremental hash.

use std::sync::Arc;

use crate::block::{BlockCoder, Compressor};
use crate::envelope::{EncodeError, EncodedFrame, FrameKind, FrameMeta};
use crate::paper::{
    Bucket, Cell, ENTRIES_PER_BUCKET, Entry, Layout, Occupancy, POINTS_PER_CELL, Placement, PointSample,
    Pose, Records, State, bucket_of, cell_id, write_body,
};

/// A point as last put.
#[derive(Debug, Clone, Copy)]
struct PointRecord {
    instance: usize,
    coord: [u32; 3],
    word: u32,
    outside: bool,
    /// Why it has no slot, or [`Placement::Stored`].
    placement: Placement,
}

/// Does the same as [`crate::paper::Encoder`], slowly. Arguments must be valid, because it indexes by them.
#[derive(Debug)]
pub struct PaperReferenceEncoder {
    layout: Arc<Layout>,
    /// Instance of every point id.
    instances: Vec<usize>,
    points: Vec<Option<PointRecord>>,
    /// Point ids in the slots of every cell.
    cells: Vec<[Option<usize>; POINTS_PER_CELL]>,
    /// Cell indices in the entries of every bucket.
    buckets: Vec<[Option<usize>; ENTRIES_PER_BUCKET]>,
    /// Free cells; the last is used next.
    free: Vec<usize>,
    poses: Vec<Pose>,
    sent: State,
}

impl PaperReferenceEncoder {
    /// Creates an encoder without points, as [`crate::paper::Encoder::new`].
    #[must_use]
    pub fn new(layout: Arc<Layout>, points: &[u32]) -> PaperReferenceEncoder {
        let owners = points.iter().enumerate();
        let instances: Vec<usize> = owners.flat_map(|(at, count)| vec![at; *count as usize]).collect();
        PaperReferenceEncoder {
            points: vec![None; instances.len()],
            instances,
            cells: vec![[None; POINTS_PER_CELL]; layout.cell_capacity() as usize],
            buckets: vec![[None; ENTRIES_PER_BUCKET]; layout.bucket_total() as usize],
            free: (0..layout.cell_capacity() as usize).rev().collect(),
            poses: vec![Pose::IDENTITY; layout.instances().len()],
            sent: State::new(Arc::clone(&layout)),
            layout,
        }
    }

    /// Puts a point, as [`crate::paper::Encoder::put`].
    pub fn put(&mut self, point: usize, sample: &PointSample) -> Placement {
        let instance = self.instances[point];
        let located = self.layout.instances()[instance].grid.locate(sample.local);
        let word = self.layout.format().pack(located.frac, sample.normal, sample.ao);
        let stays = self.points[point].is_some_and(|old| old.coord == located.cell);
        if !(stays && self.cell_of(point).is_some()) {
            self.take_out(point);
        }
        let placement = Placement::Stored;
        let outside = located.outside;
        self.points[point] = Some(PointRecord { instance, coord: located.cell, word, outside, placement });
        self.place(point)
    }

    /// Removes a point, as [`crate::paper::Encoder::remove`].
    pub fn remove(&mut self, point: usize) {
        self.take_out(point);
        self.points[point] = None;
    }

    /// Sets a pose, as [`crate::paper::Encoder::set_pose`].
    pub fn set_pose(&mut self, instance: usize, pose: Pose) {
        self.poses[instance] = pose;
    }

    /// Tries to place every point without a slot, as [`crate::paper::Encoder::retry_unplaced`].
    pub fn retry_unplaced(&mut self) {
        for point in 0..self.points.len() {
            if self.points[point].is_some() {
                self.place(point);
            }
        }
    }

    /// Counts everything, as [`crate::paper::Encoder::counts`].
    #[must_use]
    pub fn counts(&self) -> Occupancy {
        let count = |rule: &dyn Fn(&PointRecord) -> bool| {
            self.points.iter().flatten().filter(|put| rule(put)).count() as u32
        };
        Occupancy {
            cells: self.cells.iter().filter(|cell| cell.iter().any(Option::is_some)).count() as u32,
            points_stored: count(&|put| put.placement == Placement::Stored),
            bucket_full: count(&|put| put.placement == Placement::BucketFull),
            cell_full: count(&|put| put.placement == Placement::CellFull),
            no_cell: count(&|put| put.placement == Placement::NoCell),
            outside_grid: count(&|put| put.outside),
            id_collisions: count(&|put| put.placement == Placement::IdCollision),
        }
    }

    /// Returns the points with a slot: instance, cell and word.
    pub fn stored(&self) -> impl Iterator<Item = (u32, [u32; 3], u32)> + '_ {
        let stored = self.points.iter().flatten().filter(|put| put.placement == Placement::Stored);
        stored.map(|put| (put.instance as u32, put.coord, put.word))
    }

    /// Returns the state of clients after the last frame.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.sent
    }

    /// Writes a frame, as [`crate::paper::Encoder::finish`].
    ///
    /// # Errors
    /// [`EncodeError::Block`].
    pub fn finish(&mut self, meta: &FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        let base = match meta.kind {
            FrameKind::Key => State::new(Arc::clone(&self.layout)),
            FrameKind::Delta => self.sent.clone(),
        };
        self.compact();
        let mut next = base.clone();
        next.poses.clone_from(&self.poses);
        for index in 0..self.buckets.len() {
            next.buckets[index] = self.bucket(index);
        }
        for index in 0..self.cells.len() {
            if self.cells[index].iter().any(Option::is_some) {
                next.cells[index] = self.cell(index);
            }
        }
        next.hash = next.full_hash();
        next.frame = Some(meta.frame);
        let mut records = Records::new(self.layout.format());
        for index in 0..next.poses.len() {
            if next.poses[index].to_words() != base.poses[index].to_words() {
                records.push_pose(index as u32, next.poses[index]);
            }
        }
        for index in 0..next.buckets.len() {
            if next.buckets[index] != base.buckets[index] {
                records.push_bucket(index as u32, &next.buckets[index]);
            }
        }
        for index in 0..next.cells.len() {
            if next.cells[index] != base.cells[index] {
                records.push_cell(index as u32, &base.cells[index].xor(next.cells[index].words()));
            }
        }
        let frame = write_body(meta, meta.kind, next.hash, &records, &mut Compressor::new(), coder)?;
        self.sent = next;
        Ok(frame)
    }

    /// Searches all cells for the one with a slot of a point.
    fn cell_of(&self, point: usize) -> Option<usize> {
        self.cells.iter().position(|cell| cell.contains(&Some(point)))
    }

    /// Empties the slot of a point. The last point frees the cell and every entry that names it.
    fn take_out(&mut self, point: usize) {
        let Some(cell) = self.cell_of(point) else { return };
        for slot in self.cells[cell].iter_mut().filter(|slot| **slot == Some(point)) {
            *slot = None;
        }
        if self.cells[cell].iter().any(Option::is_some) {
            return;
        }
        for entry in self.buckets.iter_mut().flatten().filter(|entry| **entry == Some(cell)) {
            *entry = None;
        }
        self.free.push(cell);
    }

    /// Gives a point a slot unless it has one. Records and returns the result.
    fn place(&mut self, point: usize) -> Placement {
        let placement = match self.cell_of(point) {
            Some(_) => Placement::Stored,
            None => self.find_slot(point),
        };
        if let Some(put) = &mut self.points[point] {
            put.placement = placement;
        }
        placement
    }

    fn find_slot(&mut self, point: usize) -> Placement {
        let Some(PointRecord { instance, coord, .. }) = self.points[point] else { return Placement::NoCell };
        let (id, bucket) = self.address(instance, coord);
        let named: Vec<usize> = self.buckets[bucket].iter().flatten().copied().collect();
        let same_id =
            named.into_iter().find(|cell| self.owner(*cell).is_some_and(|(_, other, _)| other == id));
        let cell = match same_id {
            Some(cell) if self.owner(cell).is_some_and(|(_, _, other)| other != coord) => {
                return Placement::IdCollision;
            }
            Some(cell) => cell,
            None => {
                let Some(entry) = self.buckets[bucket].iter().position(Option::is_none) else {
                    return Placement::BucketFull;
                };
                let Some(cell) = self.free.pop() else { return Placement::NoCell };
                self.buckets[bucket][entry] = Some(cell);
                cell
            }
        };
        let Some(slot) = self.cells[cell].iter().position(Option::is_none) else {
            return Placement::CellFull;
        };
        self.cells[cell][slot] = Some(point);
        Placement::Stored
    }

    /// Returns the raw id and bucket of a cell of an instance.
    fn address(&self, instance: usize, coord: [u32; 3]) -> (u32, usize) {
        let layout = &self.layout.instances()[instance];
        let id = cell_id(coord, layout.grid.dims());
        (id, (layout.first_bucket + bucket_of(id, layout.bucket_count)) as usize)
    }

    /// Returns instance, raw id and coordinate of a cell, from any of its points.
    fn owner(&self, cell: usize) -> Option<(usize, u32, [u32; 3])> {
        let point = self.cells[cell].iter().flatten().next()?;
        let PointRecord { instance, coord, .. } = self.points[*point]?;
        Some((instance, self.address(instance, coord).0, coord))
    }

    /// Moves the last item in use into the first hole before it, until there is none.
    fn compact(&mut self) {
        self.cells.iter_mut().for_each(|cell| close_holes(cell));
        self.buckets.iter_mut().for_each(|bucket| close_holes(bucket));
    }

    fn cell(&self, cell: usize) -> Cell {
        let word = |slot: Option<usize>| slot.and_then(|point| self.points[point]).map_or(0, |put| put.word);
        Cell::from_words(self.cells[cell].map(word))
    }

    fn bucket(&self, bucket: usize) -> Bucket {
        let mut out = Bucket::default();
        for (entry, cell) in out.entries_mut().iter_mut().zip(self.buckets[bucket]) {
            let Some((cell, (_, id, _))) = cell.and_then(|cell| Some((cell, self.owner(cell)?))) else {
                continue;
            };
            *entry = Entry::new(id, cell as u32, self.cells[cell].iter().flatten().count() as u8);
        }
        out.compact();
        out
    }
}

fn close_holes(places: &mut [Option<usize>]) {
    loop {
        let hole = places.iter().position(Option::is_none);
        let last = places.iter().rposition(Option::is_some);
        match (hole, last) {
            (Some(hole), Some(last)) if hole < last => places.swap(hole, last),
            _ => return,
        }
    }
}
