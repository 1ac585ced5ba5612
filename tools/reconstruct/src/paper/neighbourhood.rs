//! The unpacked points of the 2 x 2 x 2 cells nearest to a place (paper, section 3.5).

use glam::Vec3;
use psao_codec::paper::State;
use psao_codec::paper::{Grid, POINTS_PER_CELL};

use crate::kernel::{LANES, Mark, PointGroup};

/// Largest number of groups in a neighbourhood: 8 cells of 7 points are 56 points (paper, section 3.5).
const MAX_GROUPS: usize = (8 * POINTS_PER_CELL).div_ceil(LANES);

/// The cells of an instance, in its local space.
#[derive(Clone, Copy)]
pub(crate) struct InstanceCells {
    instance: u32,
    grid: Grid,
    kernel_radius: f32,
}

impl InstanceCells {
    /// Returns the cells of one instance; `None` when the stream does not have it.
    pub(crate) fn of(state: &State, instance: u32) -> Option<Self> {
        let layout = state.layout().instances().get(instance as usize)?;
        Some(Self { instance, grid: layout.grid, kernel_radius: layout.kernel_radius })
    }

    /// Returns `r` of Eq. 2 in metres.
    #[inline]
    pub(crate) fn kernel_radius(&self) -> f32 {
        self.kernel_radius
    }

    /// Returns the lowest of the 2 x 2 x 2 cells whose centres are nearest to a local position. These are the cells
    /// `base` and `base + 1` on each axis; they may lie outside the grid. `None` for a position that is not finite.
    pub(crate) fn base(&self, local: Vec3) -> Option<[i64; 3]> {
        // The grid is shifted by half a cell, because the pair of cells is the same between two cell centres.
        let shifted = (local - Vec3::from(self.grid.origin())) / self.grid.edge() - 0.5;
        shifted.is_finite().then(|| shifted.floor().to_array().map(|axis| axis as i64))
    }

    /// Calls `take` with each point of the 2 x 2 x 2 cells from `base` on: local position, normal, accessibility.
    pub(crate) fn each_point(&self, state: &State, base: [i64; 3], mut take: impl FnMut(Vec3, Vec3, f32)) {
        for step in 0..8_i64 {
            let candidate = [base[0] + (step & 1), base[1] + (step >> 1 & 1), base[2] + (step >> 2)];
            let Some(cell) = inside(candidate, self.grid.dims()) else { continue };
            let Some(found) = state.lookup(self.instance, cell) else { continue };
            let corner = Vec3::from(self.grid.corner(cell));
            for point in found.points(state.layout().format()) {
                let position = corner + Vec3::from(point.frac) * self.grid.edge();
                take(position, point.normal.into(), point.accessibility());
            }
        }
    }
}

/// The unpacked points of the 2 x 2 x 2 cells from one base cell on.
#[derive(Clone)]
struct Neighbourhood {
    key: Option<(u32, [i64; 3])>,
    count: usize,
    groups: [PointGroup; MAX_GROUPS],
}

impl Neighbourhood {
    const EMPTY: Self = Self { key: None, count: 0, groups: [PointGroup::EMPTY; MAX_GROUPS] };

    fn fill(&mut self, state: &State, cells: &InstanceCells, base: [i64; 3]) {
        *self = Self { key: Some((cells.instance, base)), ..Self::EMPTY };
        cells.each_point(state, base, |position, normal, ao| {
            self.groups[self.count / LANES].set(self.count % LANES, position, normal, ao, Mark::NONE);
            self.count += 1;
        });
    }
}

/// Cache of the neighbourhoods that were needed last. Neighbouring fragments mostly share one, so unpacking is rare.
pub(crate) struct NeighbourhoodCache {
    entries: Vec<Neighbourhood>,
}

impl NeighbourhoodCache {
    /// Number of entries. Adjacent neighbourhoods, whose bases differ by one, never share an entry, nor do two
    /// consecutive instances.
    const ENTRIES: usize = 16;

    pub(crate) fn new() -> Self {
        Self { entries: vec![Neighbourhood::EMPTY; Self::ENTRIES] }
    }

    /// Returns the points of the cells from `base` on in groups of eight.
    pub(crate) fn of(&mut self, state: &State, cells: &InstanceCells, base: [i64; 3]) -> &[PointGroup] {
        let odd = base.map(|axis| (axis & 1) as usize);
        let entry = odd[0] | odd[1] << 1 | odd[2] << 2 | (cells.instance as usize & 1) << 3;
        let entry = &mut self.entries[entry];
        if entry.key != Some((cells.instance, base)) {
            entry.fill(state, cells, base);
        }
        &entry.groups[..entry.count.div_ceil(LANES)]
    }
}

/// Returns `coordinates` as a cell of a grid of `dims` cells; `None` outside the grid.
fn inside(coordinates: [i64; 3], dims: [u32; 3]) -> Option<[u32; 3]> {
    let mut cell = [0; 3];
    for axis in 0..3 {
        cell[axis] = u32::try_from(coordinates[axis]).ok().filter(|&c| c < dims[axis])?;
    }
    Some(cell)
}
