//! The working tables of the encoder: which point is in which slot of which cell (paper, sections 3.2 to 3.4).

use crate::memory;
use crate::paper::{Bucket, Cell, Entry, POINTS_PER_CELL, Placement};

/// Owner of an empty slot; no point has this id.
const NO_OWNER: u32 = u32::MAX;

/// Address of a cell of an instance: coordinate, raw id and bucket.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellAddress {
    pub(crate) coord: [u32; 3],
    pub(crate) id: u32,
    /// Index among the buckets of the state.
    pub(crate) bucket: u32,
}

/// The slots of a cell: words, owners, and the address of the cell.
#[derive(Debug, Clone)]
struct CellSlots {
    words: [u32; POINTS_PER_CELL],
    owners: [u32; POINTS_PER_CELL],
    points: u8,
    coord: [u32; 3],
    bucket: u32,
}

impl CellSlots {
    fn empty(address: CellAddress) -> CellSlots {
        CellSlots {
            words: [0; POINTS_PER_CELL],
            owners: [NO_OWNER; POINTS_PER_CELL],
            points: 0,
            coord: address.coord,
            bucket: address.bucket,
        }
    }

    fn slot_of(&self, owner: u32) -> Option<usize> {
        self.owners.iter().position(|other| *other == owner)
    }

    /// Moves points to the front (paper, section 3.4). The last point fills each hole, which moves as few words as
    /// possible.
    fn compact(&mut self) {
        let mut end = POINTS_PER_CELL;
        let mut at = 0;
        while at < end {
            if self.owners[at] == NO_OWNER {
                end -= 1;
                self.words.swap(at, end);
                self.owners.swap(at, end);
            } else {
                at += 1;
            }
        }
    }
}

/// Set of indices that changed since the last frame.
#[derive(Debug, Clone)]
pub(crate) struct DirtySet {
    marked: Vec<bool>,
    list: Vec<u32>,
}

impl DirtySet {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.marked) + memory::list(&self.list)
    }

    pub(crate) fn new(places: usize) -> DirtySet {
        DirtySet { marked: vec![false; places], list: Vec::new() }
    }

    pub(crate) fn mark(&mut self, index: u32) {
        if let Some(marked) = self.marked.get_mut(index as usize).filter(|marked| !**marked) {
            *marked = true;
            self.list.push(index);
        }
    }

    /// Returns the indices in ascending order, so that the order of changes does not show in the stream.
    pub(crate) fn sorted(&mut self) -> &[u32] {
        self.list.sort_unstable();
        &self.list
    }

    pub(crate) fn clear(&mut self) {
        for index in self.list.drain(..) {
            self.marked[index as usize] = false;
        }
    }
}

/// All cells and buckets of the server, including holes, and what changed.
#[derive(Debug, Clone)]
pub(crate) struct Tables {
    buckets: Vec<Bucket>,
    /// Grows as cells are first used, up to `capacity`.
    cells: Vec<CellSlots>,
    capacity: u32,
    /// Freed cells. The cell freed last is used first, so that its stale words are the newest.
    free: Vec<u32>,
    /// Whether a slot, entry or cell became free since [`Tables::take_freed`].
    freed: bool,
    dirty_cells: DirtySet,
    dirty_buckets: DirtySet,
}

impl Tables {
    /// Returns the number of heap bytes in use.
    pub(crate) fn heap_bytes(&self) -> usize {
        let Tables { buckets, cells, free, dirty_cells, dirty_buckets, .. } = self;
        let dirty = dirty_cells.heap_bytes() + dirty_buckets.heap_bytes();
        memory::list(buckets) + memory::list(cells) + memory::list(free) + dirty
    }

    pub(crate) fn new(bucket_total: u32, capacity: u32) -> Tables {
        Tables {
            buckets: vec![Bucket::default(); bucket_total as usize],
            cells: Vec::new(),
            capacity,
            free: Vec::new(),
            freed: false,
            dirty_cells: DirtySet::new(capacity as usize),
            dirty_buckets: DirtySet::new(bucket_total as usize),
        }
    }

    /// Returns the number of cells in use.
    pub(crate) fn cells_used(&self) -> u32 {
        (self.cells.len() - self.free.len()) as u32
    }

    /// Returns whether a place became free since the last call.
    pub(crate) fn take_freed(&mut self) -> bool {
        std::mem::take(&mut self.freed)
    }

    /// Returns a bucket; it is compact after [`Tables::compact`].
    pub(crate) fn bucket(&self, index: u32) -> Bucket {
        self.buckets.get(index as usize).copied().unwrap_or_default()
    }

    /// Returns a cell in use, or `None` if it is free. It is compact after [`Tables::compact`].
    pub(crate) fn cell(&self, index: u32) -> Option<Cell> {
        self.cells
            .get(index as usize)
            .filter(|slots| slots.points > 0)
            .map(|slots| Cell::from_words(slots.words))
    }

    /// Returns the buckets and cells that changed since [`Tables::clear_dirty`]. They ascend after
    /// [`Tables::compact`].
    pub(crate) fn dirty(&self) -> (&[u32], &[u32]) {
        (&self.dirty_buckets.list, &self.dirty_cells.list)
    }

    pub(crate) fn clear_dirty(&mut self) {
        self.dirty_buckets.clear();
        self.dirty_cells.clear();
    }

    /// Finds a slot for a point without one. Returns the cell, or why there is none.
    pub(crate) fn insert(&mut self, address: CellAddress, point: u32, word: u32) -> Result<u32, Placement> {
        let cell = self.find_or_allocate(address)?;
        let slots = &mut self.cells[cell as usize];
        let Some(slot) = slots.slot_of(NO_OWNER) else { return Err(Placement::CellFull) };
        slots.owners[slot] = point;
        slots.words[slot] = word;
        slots.points += 1;
        self.dirty_cells.mark(cell);
        self.recount(cell);
        Ok(cell)
    }

    /// Returns the cell of an address: the one that its bucket names, or else a new one.
    fn find_or_allocate(&mut self, address: CellAddress) -> Result<u32, Placement> {
        let entries = self.buckets[address.bucket as usize].entries();
        if let Some(entry) = entries.iter().find(|entry| entry.is_used() && entry.id() == address.id) {
            let found = &self.cells[entry.cell() as usize];
            return if found.coord == address.coord { Ok(entry.cell()) } else { Err(Placement::IdCollision) };
        }
        let Some(vacant) = entries.iter().position(|entry| !entry.is_used()) else {
            return Err(Placement::BucketFull);
        };
        let cell = self.allocate(address).ok_or(Placement::NoCell)?;
        // One point: the caller puts it there next, and counts again.
        self.buckets[address.bucket as usize].entries_mut()[vacant] = Entry::new(address.id, cell, 1);
        Ok(cell)
    }

    fn allocate(&mut self, address: CellAddress) -> Option<u32> {
        if let Some(cell) = self.free.pop() {
            self.cells[cell as usize] = CellSlots::empty(address);
            return Some(cell);
        }
        let cell = self.cells.len() as u32;
        (cell < self.capacity).then(|| self.cells.push(CellSlots::empty(address)))?;
        Some(cell)
    }

    /// Replaces the word of a point in `cell`.
    pub(crate) fn update(&mut self, cell: u32, point: u32, word: u32) {
        let slots = &mut self.cells[cell as usize];
        if let Some(slot) = slots.slot_of(point).filter(|slot| slots.words[*slot] != word) {
            slots.words[slot] = word;
            self.dirty_cells.mark(cell);
        }
    }

    /// Empties the slot of a point in `cell`. The last point frees the cell and its entry.
    pub(crate) fn remove(&mut self, cell: u32, point: u32) {
        let slots = &mut self.cells[cell as usize];
        let Some(slot) = slots.slot_of(point) else { return };
        slots.owners[slot] = NO_OWNER;
        slots.words[slot] = 0;
        slots.points -= 1;
        self.freed = true;
        if slots.points == 0 {
            self.free.push(cell);
        }
        self.dirty_cells.mark(cell);
        self.recount(cell);
    }

    /// Updates the point count of a cell's bucket entry. An entry without points is cleared.
    fn recount(&mut self, cell: u32) {
        let CellSlots { bucket, points, .. } = self.cells[cell as usize];
        self.dirty_buckets.mark(bucket);
        let entries = self.buckets[bucket as usize].entries_mut();
        if let Some(entry) = entries.iter_mut().find(|entry| entry.is_used() && entry.cell() == cell) {
            if points == 0 {
                *entry = Entry::default();
            } else {
                entry.set_points(points);
            }
        }
    }

    /// Moves what is in use to the front, in every cell and bucket that changed (paper, section 3.4).
    pub(crate) fn compact(&mut self) {
        for cell in self.dirty_cells.sorted() {
            self.cells[*cell as usize].compact();
        }
        for bucket in self.dirty_buckets.sorted() {
            self.buckets[*bucket as usize].compact();
        }
    }
}
