//! The nearest points of a chart, for places that have too few points around them.

use super::grid::IndexPoint;

/// Number of points that [`ChartTree::nearest`] finds at most.
pub(crate) const NEAREST_POINTS: usize = 6;

/// Number of points that are looked at for one place at most. More are needed only where most points of a chart have no
/// value yet; then some of the nearest may be missed.
const MAX_VISITS: u32 = 512;

/// A balanced k-d tree for each chart of a set (J. L. Bentley, "Multidimensional binary search trees used for associative
/// searching", 1975). The root of a range is its middle; its halves are cut along the next axis.
#[derive(Clone, Debug)]
pub(crate) struct ChartTree {
    /// Charts that have points, ascending, and the end of each chart's range. A range begins where the one before ends.
    charts: Vec<(u32, u32)>,
    /// Positions in the index's list of points.
    order: Vec<u32>,
}

/// The nearest points found: squared distances, ascending, and positions in the index's list.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    found: [(f32, u32); NEAREST_POINTS],
    count: usize,
    visits: u32,
}

impl Nearest {
    /// Returns the positions of the points in the index's list, and the distance of the farthest in metres.
    pub(crate) fn points(&self) -> (impl Iterator<Item = u32> + '_, f32) {
        let found = &self.found[..self.count];
        (found.iter().map(|found| found.1), found.last().map_or(0.0, |found| found.0.sqrt()))
    }

    fn worst(&self) -> f32 {
        if self.count < NEAREST_POINTS { f32::INFINITY } else { self.found[NEAREST_POINTS - 1].0 }
    }

    fn offer(&mut self, square: f32, at: u32) {
        if square >= self.worst() {
            return;
        }
        let place = self.found[..self.count].partition_point(|found| found.0 <= square);
        let end = self.count.min(NEAREST_POINTS - 1);
        self.found.copy_within(place..end, place + 1);
        self.found[place] = (square, at);
        self.count = end + 1;
    }
}

impl ChartTree {
    /// Builds the trees in O(n log n) time. `chart` gives the chart of a point.
    pub(crate) fn new(points: &[IndexPoint], chart: impl Fn(&IndexPoint) -> u32) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by_key(|&at| (chart(&points[at as usize]), at));
        let mut charts = Vec::new();
        let mut start = 0;
        for run in order.clone().chunk_by(|&a, &b| chart(&points[a as usize]) == chart(&points[b as usize])) {
            let end = start + run.len();
            build(points, &mut order[start..end], 0);
            charts.push((chart(&points[run[0] as usize]), end as u32));
            start = end;
        }
        Self { charts, order }
    }

    pub(crate) fn heap_bytes(&self) -> usize {
        size_of_val(self.charts.as_slice()) + size_of_val(self.order.as_slice())
    }

    /// Finds the points of a chart that are nearest to a place, among those for which `counts` is true.
    pub(crate) fn nearest(
        &self,
        points: &[IndexPoint],
        chart: u32,
        place: [f32; 3],
        counts: impl Fn(&IndexPoint) -> bool,
    ) -> Nearest {
        let mut nearest =
            Nearest { found: [(f32::INFINITY, 0); NEAREST_POINTS], count: 0, visits: MAX_VISITS };
        if let Ok(at) = self.charts.binary_search_by_key(&chart, |chart| chart.0) {
            let start = at.checked_sub(1).map_or(0, |before| self.charts[before].1) as usize;
            let range = &self.order[start..self.charts[at].1 as usize];
            search(points, range, 0, place, &counts, &mut nearest);
        }
        nearest
    }
}

fn build(points: &[IndexPoint], order: &mut [u32], axis: usize) {
    if order.len() < 2 {
        return;
    }
    let middle = order.len() / 2;
    let along = |at: &u32| points[*at as usize].position[axis];
    order.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
    let (lower, upper) = order.split_at_mut(middle);
    build(points, lower, (axis + 1) % 3);
    build(points, &mut upper[1..], (axis + 1) % 3);
}

fn search(
    points: &[IndexPoint],
    order: &[u32],
    axis: usize,
    place: [f32; 3],
    counts: &impl Fn(&IndexPoint) -> bool,
    nearest: &mut Nearest,
) {
    let middle = order.len() / 2;
    let Some(&at) = order.get(middle) else { return };
    if nearest.visits == 0 {
        return;
    }
    nearest.visits -= 1;
    let point = &points[at as usize];
    if counts(point) {
        nearest.offer(point.position.distance_squared(place.into()), at);
    }
    let past = place[axis] - point.position[axis];
    let (lower, upper) = (&order[..middle], &order[middle + 1..]);
    let (first, second) = if past < 0.0 { (lower, upper) } else { (upper, lower) };
    search(points, first, (axis + 1) % 3, place, counts, nearest);
    if past * past < nearest.worst() {
        search(points, second, (axis + 1) % 3, place, counts, nearest);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_nearest_are_those_of_a_scan(
            coordinates in prop::collection::vec((prop::array::uniform3(0_i8..8), 0_u32..3), 0..120),
            place in prop::array::uniform3(-2.0_f32..10.0),
            chart in 0_u32..4,
        ) {
            let points: Vec<IndexPoint> = (0..)
                .zip(&coordinates)
                .map(|(point, (at, _))| IndexPoint { position: Vec3::from(at.map(f32::from)), normal: Vec3::Y, point })
                .collect();
            let tree = ChartTree::new(&points, |point| coordinates[point.point as usize].1);
            let counts = |point: &IndexPoint| !point.point.is_multiple_of(5);
            let found = tree.nearest(&points, chart, place, counts);
            let mut wanted: Vec<f32> = points
                .iter()
                .filter(|point| counts(point) && coordinates[point.point as usize].1 == chart)
                .map(|point| point.position.distance_squared(place.into()))
                .collect();
            wanted.sort_by(f32::total_cmp);
            wanted.truncate(NEAREST_POINTS);
            let squares: Vec<f32> = found.found[..found.count].iter().map(|found| found.0).collect();
            prop_assert_eq!(squares, wanted);
        }
    }

    #[test]
    fn a_search_ends_where_no_point_has_a_value() {
        let points: Vec<IndexPoint> =
            (0..10_000).map(|point| IndexPoint { position: Vec3::ZERO, normal: Vec3::Y, point }).collect();
        let tree = ChartTree::new(&points, |_| 0);
        let looked = std::cell::Cell::new(0);
        let none = tree.nearest(&points, 0, [0.0; 3], |_| {
            looked.set(looked.get() + 1);
            false
        });
        assert_eq!((none.count, looked.get()), (0, MAX_VISITS));
    }
}
