//! What became of points: placed, or without a slot and counted.

/// What became of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Placement {
    /// It has a slot.
    Stored,
    /// Its bucket's eight entries name other cells.
    BucketFull,
    /// Its cell holds seven other points.
    CellFull,
    /// All cells of the layout are in use.
    NoCell,
    /// Another cell of the instance has the same raw id, so the client could not tell the two apart.
    IdCollision,
}

/// What became of a point, and whether it was inside its grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PutOutcome {
    /// Whether it has a slot, and if not, why.
    pub placement: Placement,
    /// Whether it was outside its instance's grid and moved to the nearest position inside.
    pub outside: bool,
}

/// How full the tables are, and what did not fit. Points count once, wherever they are now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Occupancy {
    /// Cells in use.
    pub cells: u32,
    /// Points that have a slot.
    pub points_stored: u32,
    /// Points without a slot because their bucket is full.
    pub bucket_full: u32,
    /// Points without a slot because their cell is full.
    pub cell_full: u32,
    /// Points without a slot because no cell is free.
    pub no_cell: u32,
    /// Points, with a slot or without, that were outside their grid.
    pub outside_grid: u32,
    /// Points without a slot because another cell has the raw id of theirs.
    pub id_collisions: u32,
}

impl Occupancy {
    pub(crate) fn count_mut(&mut self, placement: Placement) -> &mut u32 {
        match placement {
            Placement::Stored => &mut self.points_stored,
            Placement::BucketFull => &mut self.bucket_full,
            Placement::CellFull => &mut self.cell_full,
            Placement::NoCell => &mut self.no_cell,
            Placement::IdCollision => &mut self.id_collisions,
        }
    }

    /// Points that have no slot, for whatever reason.
    #[must_use]
    pub fn unplaced(&self) -> u32 {
        self.bucket_full + self.cell_full + self.no_cell + self.id_collisions
    }
}
