//! Parents of points: up to four near points of coarser levels, from which a point is predicted.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::surface::{BLOCK_POINTS, Geometry, Layout, NO_VALUE, State};

/// A parent of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Parent {
    /// Its place in the list of all points.
    pub(super) place: usize,
    pub(super) weight: i32,
}

/// Weighted mean of what the parents tell, and how far they lie apart.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Mean {
    pub(super) mean: i32,
    pub(super) spread: i32,
}

/// Returns the parents of every padded index of a state.
pub(super) fn of_state(state: &State) -> Vec<Vec<Parent>> {
    let layout = state.layout();
    let mut first = 0;
    let mut starts = Vec::new();
    for member in layout.members() {
        starts.push(first);
        first += (layout.sets()[member.set as usize].points as usize).next_multiple_of(BLOCK_POINTS);
    }
    of_instances(layout, &state.geometry, &starts, first)
}

/// Returns the parents of `count` places. The points of each instance have the places from its start on.
pub(super) fn of_instances(
    layout: &Layout,
    geometry: &[Option<Arc<Geometry>>],
    starts: &[usize],
    count: usize,
) -> Vec<Vec<Parent>> {
    let none: Vec<Vec<Parent>> = Vec::new();
    let of_sets: Vec<_> =
        geometry.iter().map(|set| set.as_ref().map_or(none.clone(), |set| of_set(set))).collect();
    let mut parents = vec![Vec::new(); count];
    for (member, start) in layout.members().iter().zip(starts) {
        for (point, found) in of_sets[member.set as usize].iter().enumerate() {
            let shifted = found.iter().map(|parent| Parent { place: start + parent.place, ..*parent });
            parents[start + point] = shifted.collect();
        }
    }
    parents
}

/// Returns the parents of every point of a set.
pub(super) fn of_set(geometry: &Geometry) -> Vec<Vec<Parent>> {
    let ends = geometry.layout().levels.ends();
    let level = |point: usize| ends.iter().filter(|end| **end as usize <= point).count();
    let levels: Vec<usize> = (0..geometry.len()).map(level).collect();
    (0..geometry.len()).map(|point| of_point(geometry, &levels, point)).collect()
}

fn of_point(geometry: &Geometry, levels: &[usize], point: usize) -> Vec<Parent> {
    if levels[point] == 0 {
        return Vec::new();
    }
    let reach = reach_square(geometry, levels[point] - 1);
    let edge = reach.isqrt() + 1;
    let cell = |point: usize| geometry.node(point).map(|axis| u64::from(axis) / edge);
    let middle = cell(point);
    let mut cells: BTreeMap<[u64; 3], Vec<usize>> = BTreeMap::new();
    for other in (0..geometry.len()).filter(|other| levels[*other] < levels[point]) {
        let beside = cell(other).into_iter().zip(middle).all(|(a, b)| a.abs_diff(b) <= 1);
        if beside && geometry.chart(other) == geometry.chart(point) {
            cells.entry(cell(other)).or_default().push(other);
        }
    }
    let highest = cells.values().flat_map(|points| points.iter().rev().take(16));
    let mut near: Vec<(u64, usize)> =
        highest.map(|other| (square_distance(geometry, *other, point), *other)).collect();
    near.retain(|(square, _)| *square <= reach);
    near.sort_unstable();
    near.truncate(4);
    let far = near.last().map_or(0, |(square, _)| *square);
    near.iter().map(|(square, place)| Parent { place: *place, weight: weight(*square, far) }).collect()
}

/// Returns the square of the largest distance of a parent whose level is `coarser` at most, in nodes: that of one and a
/// half spacings of that level. From a level to the next coarser one, the square of the spacing doubles.
fn reach_square(geometry: &Geometry, coarser: usize) -> u64 {
    let layout = geometry.layout();
    let finest = f64::from(layout.kernel_radius) / f64::from(layout.step) * (5.0 / 9.0);
    let mut square = finest * finest;
    for _ in coarser + 1..usize::from(layout.levels.count()) {
        square *= 2.0;
    }
    (2.25 * square).floor() as u64
}

fn square_distance(geometry: &Geometry, a: usize, b: usize) -> u64 {
    let (a, b) = (geometry.node(a), geometry.node(b));
    (0..3).map(|axis| u64::from(a[axis].abs_diff(b[axis])) * u64::from(a[axis].abs_diff(b[axis]))).sum()
}

/// Returns the weight of a parent: 1, and 252 times what 3/4 of its square leaves of that of the farthest one.
fn weight(square: u64, far: u64) -> i32 {
    if far == 0 {
        return 253;
    }
    1 + (252 * (4 * far - 3 * square) / (4 * far)) as i32
}

/// Returns the mean of numbers, each with its weight: rounded to the nearest integer, and halves upwards.
fn mean(numbers: &[(i32, i32)]) -> Option<Mean> {
    let weights: i32 = numbers.iter().map(|(_, weight)| weight).sum();
    let sum: i32 = numbers.iter().map(|(number, weight)| number * weight).sum();
    let (least, _) = numbers.iter().min()?;
    let (largest, _) = numbers.iter().max()?;
    let mean = (2 * sum + weights).div_euclid(2 * weights);
    Some(Mean { mean, spread: (largest - least).min(255) })
}

/// Returns the mean of the bytes of those parents that have a value. `values` has 0 where nothing was received.
pub(super) fn mean_value(parents: &[Parent], values: &[u8]) -> Option<Mean> {
    let with_value = parents.iter().filter(|parent| values[parent.place] != NO_VALUE);
    let numbers: Vec<_> = with_value.map(|parent| (i32::from(values[parent.place]), parent.weight)).collect();
    mean(&numbers)
}

/// Returns the mean change of the parents that have a value both before and after a frame. Without such a parent it is 0.
pub(super) fn mean_change(parents: &[Parent], before: &[u8], after: &[u8]) -> Mean {
    let stays = |parent: &&Parent| before[parent.place] != NO_VALUE && after[parent.place] != NO_VALUE;
    let change = |place: usize| i32::from(after[place]) - i32::from(before[place]);
    let numbers: Vec<_> =
        parents.iter().filter(stays).map(|parent| (change(parent.place), parent.weight)).collect();
    mean(&numbers).unwrap_or_default()
}

/// Returns the byte of a point that follows its parents. One without a value stays so.
pub(super) fn followed(before: u8, change: Mean) -> u8 {
    if before == NO_VALUE { NO_VALUE } else { (i32::from(before) + change.mean).clamp(1, 255) as u8 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::surface::RestPoint;
    use crate::testing::lattice;

    /// Returns a set of points, given as nodes and charts.
    fn geometry(points: &[([u32; 3], u32)], kernel_radius: f32) -> Geometry {
        let layout = lattice(3, kernel_radius);
        let rest = |(node, chart): &([u32; 3], u32)| RestPoint {
            position: node.map(|axis| axis as f32 / 256.0),
            normal: [0.0, 1.0, 0.0],
            chart: *chart,
        };
        Geometry::round(layout, &points.iter().map(rest).collect::<Vec<_>>()).geometry
    }

    /// Checks the parents of all points against those of the reference.
    fn check(geometry: &Geometry) {
        let expected = of_set(geometry);
        for (block, points) in (0..geometry.len()).collect::<Vec<_>>().chunks(BLOCK_POINTS).enumerate() {
            let Some(found) = geometry.parents(block) else {
                assert_eq!(geometry.layout().levels.count(), 1);
                assert!(expected.iter().all(Vec::is_empty));
                continue;
            };
            for (point, parents) in points.iter().zip(&found.points) {
                let pairs = parents.points.into_iter().zip(parents.weights).filter(|(_, weight)| *weight > 0);
                let parents: Vec<Parent> = pairs
                    .map(|(point, weight)| Parent { place: point as usize, weight: weight.into() })
                    .collect();
                assert_eq!(parents, expected[*point], "point {point}");
                for Parent { place, weight } in parents {
                    assert!((64..=253).contains(&weight), "{weight}");
                    assert!(place < *point && geometry.level(place) < geometry.level(*point));
                    assert_eq!(geometry.chart(place), geometry.chart(*point));
                }
            }
            let used = points.iter().flat_map(|point| &expected[*point]);
            let others: std::collections::BTreeSet<u32> = used
                .map(|parent| (parent.place / BLOCK_POINTS) as u32)
                .filter(|at| *at as usize != block)
                .collect();
            assert!(found.blocks.iter().copied().eq(others));
        }
    }

    fn cloud() -> impl Strategy<Value = Vec<([u32; 3], u32)>> {
        let spread =
            (0_u32..256, 0_u32..8, 0_u32..256, 0_u32..3).prop_map(|(x, y, z, chart)| ([x, y, z], chart));
        let together = (0_u32..4, 0_u32..3).prop_map(|(x, chart)| ([100 + x, 0, 100], chart));
        (prop::collection::vec(spread, 0..700), prop::collection::vec(together, 0..150))
            .prop_map(|(a, b)| [a, b].concat())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn parents_are_those_of_the_reference(points in cloud(), kernel_radius in 0.005_f32..0.5) {
            check(&geometry(&points, kernel_radius));
        }
    }

    #[test]
    fn points_at_one_node_have_the_highest_of_it_as_parents() {
        let geometry = geometry(&[([7, 0, 9], 1); 1000], 0.1);
        check(&geometry);
        let parents = of_set(&geometry);
        let last = parents.last().unwrap();
        assert!(last.iter().all(|parent| parent.weight == 253));
        // Of the points at the node it looks at 16 only: the lowest four of these.
        let end = geometry.layout().levels.ends().last().copied().unwrap() as usize;
        let first = end.saturating_sub(16);
        assert!(last.iter().map(|parent| parent.place).eq((first..end).take(4)));
    }

    #[test]
    fn means_are_rounded_to_the_nearest_and_halves_upwards() {
        let of = |numbers: &[(i32, i32)]| mean(numbers).map(|mean| (mean.mean, mean.spread));
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[(3, 64), (4, 64)]), Some((4, 1)));
        assert_eq!(of(&[(-3, 64), (-4, 64)]), Some((-3, 1)));
        assert_eq!(of(&[(-254, 253), (254, 64)]), Some((-151, 255)));
    }
}
