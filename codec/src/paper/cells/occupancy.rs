//! Results of placing points, and how full the tables are.

/// Result of placing a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Placement {
    /// The point has a slot.
    Stored,
    /// The eight entries of its bucket name other cells.
    BucketFull,
    /// Its cell holds seven other points.
    CellFull,
    /// All cells of the layout are in use.
    NoCell,
    /// Another cell of the instance has the same raw id, so that clients could not tell the two apart.
    IdCollision,
}

/// Result of putting a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PutOutcome {
    /// Whether the point has a slot, and if not, why.
    pub placement: Placement,
    /// Whether the point was outside its instance's grid and moved to the nearest position inside.
    pub outside: bool,
}

/// How full the tables are, and what did not fit. Every point counts once, by its last placement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Occupancy {
    /// Cells in use.
    pub cells: u32,
    /// Points with a slot.
    pub points_stored: u32,
    /// Points without a slot because their bucket is full.
    pub bucket_full: u32,
    /// Points without a slot because their cell is full.
    pub cell_full: u32,
    /// Points without a slot because no cell is free.
    pub no_cell: u32,
    /// Points that were outside their grid, with or without a slot.
    pub outside_grid: u32,
    /// Points without a slot because another cell has the raw id of their cell.
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

    /// Returns the number of points without a slot.
    #[must_use]
    pub fn unplaced(&self) -> u32 {
        self.bucket_full + self.cell_full + self.no_cell + self.id_collisions
    }
}
