//! Points of a set by chart and cell, for searches of what is near.

use super::model::curve::AXIS_BITS;
use crate::memory;

/// Points of a cell that a search visits: those of the highest numbers. So many points at one place cost no more.
const MOST_OF_CELL: usize = 16;

/// Largest coordinate of a node or cell.
const MOST_COORD: u32 = (1 << AXIS_BITS) - 1;

/// The first points of a set, ordered by chart and cell.
#[derive(Debug)]
pub(super) struct CellIndex {
    /// Edge of a cell, nodes of the lattice.
    edge: u32,
    /// Every cell with a point, ascending, and where its points begin.
    cells: Vec<(CellKey, u32)>,
    points: Vec<u32>,
}

/// Chart, and the coordinates of the cell, 21 bits each.
type CellKey = (u32, u64);

impl CellIndex {
    /// Creates the index of the points `0..end`. `place` returns the chart and the node of a point.
    pub(super) fn new(edge: u32, end: u32, place: impl Fn(u32) -> (u32, [u32; 3])) -> CellIndex {
        let mut keyed: Vec<(CellKey, u32)> = (0..end)
            .map(|point| {
                let (chart, coord) = place(point);
                ((chart, key(coord.map(|axis| axis / edge))), point)
            })
            .collect();
        keyed.sort_unstable();
        let points = keyed.iter().map(|(_, point)| *point).collect();
        let mut cells: Vec<(CellKey, u32)> = Vec::new();
        for ((cell, _), at) in keyed.into_iter().zip(0..) {
            if cells.last().is_none_or(|(last, _)| *last != cell) {
                cells.push((cell, at));
            }
        }
        CellIndex { edge, cells, points }
    }

    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        memory::list(&self.cells) + memory::list(&self.points)
    }

    /// Returns points of a chart in the 27 cells around a node: at most 16 of each cell.
    pub(super) fn around(&self, chart: u32, coord: [u32; 3]) -> impl Iterator<Item = u32> + '_ {
        let [x, y, z] = coord.map(|axis| axis / self.edge);
        let near = |axis: u32| axis.saturating_sub(1)..=(axis + 1).min(MOST_COORD);
        let rows = near(x).flat_map(move |x| near(y).map(move |y| (x, y)));
        rows.flat_map(move |(x, y)| {
            // The three cells of a row follow each other.
            let (first, last) = (key([x, y, z.saturating_sub(1)]), key([x, y, (z + 1).min(MOST_COORD)]));
            let from = self.cells.partition_point(|(cell, _)| *cell < (chart, first));
            let cells =
                self.cells[from..].iter().take_while(move |(cell, _)| *cell <= (chart, last)).enumerate();
            cells.flat_map(move |(at, (_, start))| {
                let end =
                    self.cells.get(from + at + 1).map_or(self.points.len(), |(_, start)| *start as usize);
                let start = (*start as usize).max(end.saturating_sub(MOST_OF_CELL));
                self.points[start..end].iter().copied()
            })
        })
    }
}

/// Packs the coordinates of a cell.
fn key([x, y, z]: [u32; 3]) -> u64 {
    u64::from(x) << (2 * AXIS_BITS) | u64::from(y) << AXIS_BITS | u64::from(z)
}
