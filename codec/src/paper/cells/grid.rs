//! The virtual grid of an instance, and the hash of a cell (paper, section 3.2, Eq. 1).

use crate::paper::GridError;

/// Largest number of cells along one axis: 2^21. Beyond, `f32` cannot resolve a position in its cell.
pub const MAX_GRID_DIM: u32 = 1 << 21;

/// A grid of cubic cells over the metric local space of an instance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    origin: [f32; 3],
    edge: f32,
    dims: [u32; 3],
}

/// Cell of a position in a [`Grid`], and the place in that cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridLocation {
    /// The cell, each coordinate below the grid's dimension.
    pub cell: [u32; 3],
    /// Place in the cell, 0 to 1 an axis.
    pub frac: [f32; 3],
    /// Whether the position is outside the grid. Then `cell` and `frac` are those of the nearest position inside.
    pub outside: bool,
}

impl Grid {
    /// Creates a grid with its low corner at `origin` (metres, instance-local), cubic cells of `edge` metres, and
    /// `dims` cells along x, y and z.
    ///
    /// # Errors
    /// [`GridError`] if the origin or the far corner is not finite, the edge is not finite and above 0, or a dimension
    /// is outside 1 to [`MAX_GRID_DIM`].
    pub fn new(origin: [f32; 3], edge: f32, dims: [u32; 3]) -> Result<Grid, GridError> {
        if !origin.iter().all(|axis| axis.is_finite()) {
            return Err(GridError::Origin { origin });
        }
        if !(edge.is_normal() && edge > 0.0) {
            return Err(GridError::Edge { edge });
        }
        if !dims.iter().all(|dim| (1..=MAX_GRID_DIM).contains(dim)) {
            return Err(GridError::Dims { dims });
        }
        let grid = Grid { origin, edge, dims };
        if !grid.corner(dims).iter().all(|axis| axis.is_finite()) {
            return Err(GridError::Extent { edge, dims });
        }
        Ok(grid)
    }

    /// Returns the low corner, metres, instance-local.
    #[must_use]
    pub fn origin(&self) -> [f32; 3] {
        self.origin
    }

    /// Returns the edge of a cell, metres.
    #[must_use]
    pub fn edge(&self) -> f32 {
        self.edge
    }

    /// Returns the number of cells along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// Returns the cell of a position (metres, instance-local) and the place in it.
    ///
    /// A position outside moves to the nearest one inside, axis by axis, and is marked. NaN counts as outside, below.
    /// A position on the far face is inside and belongs to the last cell.
    #[must_use]
    pub fn locate(&self, position: [f32; 3]) -> GridLocation {
        let mut located = GridLocation { cell: [0; 3], frac: [0.0; 3], outside: false };
        for (axis, along) in position.into_iter().enumerate() {
            let at = (along - self.origin[axis]) / self.edge;
            let far = self.dims[axis] as f32;
            located.outside |= !(at >= 0.0 && at <= far);
            let inside = at.max(0.0).min(far);
            // The cast truncates; the far face belongs to the last cell.
            let cell = (inside as u32).min(self.dims[axis] - 1);
            located.cell[axis] = cell;
            located.frac[axis] = inside - cell as f32;
        }
        located
    }

    /// Returns the low corner of a cell, metres, instance-local.
    #[must_use]
    pub fn corner(&self, cell: [u32; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| self.origin[axis] + cell[axis] as f32 * self.edge)
    }
}

/// Returns the raw id of a cell in a grid of `dims` cells (Eq. 1): `x + y * Dx * 17 + z * Dx * Dy * 31`.
///
/// All arithmetic wraps at 2^32. Below the wrap, different cells have different ids. In larger grids (more than some
/// 10^8 cells) two cells can share an id.
#[inline]
#[must_use]
pub fn cell_id(cell: [u32; 3], dims: [u32; 3]) -> u32 {
    let row = dims[0].wrapping_mul(17);
    let slab = dims[0].wrapping_mul(dims[1]).wrapping_mul(31);
    cell[0].wrapping_add(cell[1].wrapping_mul(row)).wrapping_add(cell[2].wrapping_mul(slab))
}

/// Returns the bucket of a raw id, counted from the first bucket of the instance: `id` modulo `bucket_count`, a power
/// of two.
#[inline]
#[must_use]
pub fn bucket_of(id: u32, bucket_count: u32) -> u32 {
    id & bucket_count.wrapping_sub(1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::paper::{ENTRIES_PER_BUCKET, bucket_count};

    /// Returns the percentage of cells that find no entry in a table of buckets, by Eq. 1.
    fn lost(cells: impl Iterator<Item = [u32; 3]>, dims: [u32; 3], buckets: u32) -> f64 {
        let mut used = vec![0_usize; buckets as usize];
        let mut total = 0;
        for cell in cells {
            used[bucket_of(cell_id(cell, dims), buckets) as usize] += 1;
            total += 1;
        }
        let stored: usize = used.into_iter().map(|count| count.min(ENTRIES_PER_BUCKET)).sum();
        100.0 * (1.0 - stored as f64 / f64::from(total))
    }

    /// Returns that percentage for all cells of the plane x = 3, with four and with eight slots for each cell.
    fn lost_on_a_plane(dims: [u32; 3]) -> [f64; 2] {
        let plane = || (0..dims[2]).flat_map(move |z| (0..dims[1]).map(move |y| [3, y, z]));
        let area = (dims[1] * dims[2]) as f32;
        [4.0, 8.0].map(|slots| lost(plane(), dims, bucket_count(area, 1.0, slots)))
    }

    #[test]
    fn eq_1_loses_axis_aligned_planes_in_power_of_two_tables() {
        // 128 of 32,768 buckets are ever hit: the rest of y and all of z vanish modulo a power of two.
        let [paper, twice] = lost_on_a_plane([256; 3]);
        assert!((98.4..98.5).contains(&paper), "{paper} %");
        assert!((96.8..96.9).contains(&twice), "{twice} %");
        let [flat, _] = lost_on_a_plane([512, 16, 512]);
        assert!((99.2..99.25).contains(&flat), "{flat} %");
    }

    #[test]
    fn eq_1_wraps_at_32_bits() {
        let dims = [260, 260, 2050];
        assert_eq!(cell_id([4, 0, 0], dims), cell_id([0, 245, 2049], dims));
        assert_eq!(cell_id([1, 2, 3], [10, 20, 30]), 1 + 2 * 10 * 17 + 3 * 10 * 20 * 31);
    }

    #[test]
    fn positions_on_faces_and_outside() {
        let grid = Grid::new([1.0, 2.0, 3.0], 0.5, [2, 3, 4]).unwrap();
        let far = grid.locate([2.0, 3.5, 5.0]);
        assert_eq!(far, GridLocation { cell: [1, 2, 3], frac: [1.0; 3], outside: false });
        let beyond = grid.locate([2.1, 3.5, 9.0]);
        assert_eq!(beyond, GridLocation { cell: [1, 2, 3], frac: [1.0; 3], outside: true });
        let before = grid.locate([0.0, 2.0, f32::NAN]);
        assert_eq!(before, GridLocation { cell: [0; 3], frac: [0.0; 3], outside: true });
    }

    #[test]
    fn grids_that_make_no_sense_are_refused() {
        let one = [1, 1, 1];
        assert!(matches!(Grid::new([f32::NAN, 0.0, 0.0], 1.0, one), Err(GridError::Origin { .. })));
        for edge in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-45] {
            assert!(matches!(Grid::new([0.0; 3], edge, one), Err(GridError::Edge { .. })), "{edge}");
        }
        for dims in [[0, 1, 1], [1, MAX_GRID_DIM + 1, 1]] {
            assert_eq!(Grid::new([0.0; 3], 1.0, dims), Err(GridError::Dims { dims }));
        }
        let dims = [MAX_GRID_DIM, 1, 1];
        assert_eq!(Grid::new([0.0; 3], 1e38, dims), Err(GridError::Extent { edge: 1e38, dims }));
    }

    proptest! {
        #[test]
        fn a_position_is_where_locate_says(position in prop::array::uniform3(0.0_f32..8.0)) {
            let grid = Grid::new([-1.0; 3], 0.25, [40; 3]).unwrap();
            let located = grid.locate(position);
            prop_assert!(!located.outside);
            let corner = grid.corner(located.cell);
            for axis in 0..3 {
                prop_assert!((0.0..=1.0).contains(&located.frac[axis]));
                prop_assert!((corner[axis] + located.frac[axis] * 0.25 - position[axis]).abs() < 1e-5);
            }
        }

        #[test]
        fn ids_are_distinct_below_the_wrap(
            dims in prop::array::uniform3(1_u32..40), a in any::<[u32; 3]>(), b in any::<[u32; 3]>(),
        ) {
            let [a, b] = [a, b].map(|cell| [cell[0] % dims[0], cell[1] % dims[1], cell[2] % dims[2]]);
            prop_assert_eq!(a == b, cell_id(a, dims) == cell_id(b, dims));
        }
    }
}
