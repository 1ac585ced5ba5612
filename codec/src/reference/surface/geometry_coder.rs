//! Decodes points by halving boxes.

use std::collections::BTreeMap;

use super::geometry::{Point, levels};
use super::significant;
use crate::range::{BinaryCoder, BitModel, NumberModel, RangeDecoder};
use crate::surface::SetLayout;

/// The question that a decision answers.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Question {
    LowerEmpty,
    UpperEmpty,
    Share,
    Above,
    SameAsFirst,
    SameAsSecond,
    ExpectedChart,
}

/// What the range coder learns of the points of one frame.
pub(super) struct GeometryDecoder {
    pub(super) numbers: NumberModel,
    models: BTreeMap<(Question, [usize; 3]), BitModel>,
    turn: [NumberModel; 2],
    /// Whether the last point's normal was the one expected.
    was_same: bool,
    jump: NumberModel,
    /// Whether the last point's chart was the one expected.
    was_alike: bool,
}

/// A decoded point and its normal, not of unit length.
struct DecodedPoint {
    point: Point,
    direction: [i64; 3],
}

/// The code of a normal, its source (0 first candidate, 1 second, 2 none), and the class of the misfit and the chart of the
/// candidate whose chart is expected.
type FoundNormal = (u16, usize, Option<(usize, u32)>);

/// A box of the lattice: its lowest node, and the logarithms of its edges.
#[derive(Clone, Copy)]
struct Cuboid {
    low: [u32; 3],
    size: [u32; 3],
}

impl GeometryDecoder {
    pub(super) fn new() -> GeometryDecoder {
        let turn = [NumberModel::new(), NumberModel::new()];
        GeometryDecoder {
            numbers: NumberModel::new(),
            models: BTreeMap::new(),
            turn,
            was_same: true,
            jump: NumberModel::new(),
            was_alike: true,
        }
    }

    fn ask(&mut self, decoder: &mut RangeDecoder<'_>, question: Question, context: [usize; 3]) -> bool {
        let model = self.models.entry((question, context)).or_insert(BitModel::new(1 << 15));
        let bit = decoder.bit(model.one(), false);
        model.learn(bit);
        bit
    }

    /// Returns the points of a set, level by level, in the order of the boxes; `None` if they break a rule.
    pub(super) fn points(&mut self, decoder: &mut RangeDecoder<'_>, set: &SetLayout) -> Option<Vec<Point>> {
        let size = set.extent.map(|extent| significant(extent.into()) as u32);
        let mut found = Vec::new();
        for level in levels(set) {
            self.cuboid(decoder, set, Cuboid { low: [0; 3], size }, level.len(), &mut found)?;
        }
        Some(found.into_iter().map(|found| found.point).collect())
    }

    fn cuboid(
        &mut self,
        decoder: &mut RangeDecoder<'_>,
        set: &SetLayout,
        cuboid: Cuboid,
        count: usize,
        found: &mut Vec<DecodedPoint>,
    ) -> Option<()> {
        if decoder.is_exhausted() {
            return None;
        }
        if count == 1 || cuboid.size == [0; 3] {
            for _ in 0..count {
                let point = self.point(decoder, set, cuboid, found)?;
                found.push(DecodedPoint { point, direction: direction(set.normal_bits, point.1) });
            }
            return Some(());
        }
        if count == 0 {
            return Some(());
        }
        let axis = first_longest(cuboid.size);
        let mut halves = [cuboid; 2];
        halves[0].size[axis] -= 1;
        halves[1].size[axis] -= 1;
        halves[1].low[axis] += 1 << halves[1].size[axis];
        let across = found.last().is_some_and(|last| steepest(&last.direction) == axis);
        let context = [count.min(16), usize::from(across), cuboid.size[axis].min(7) as usize];
        let lower = if self.ask(decoder, Question::LowerEmpty, context) {
            0
        } else if self.ask(decoder, Question::UpperEmpty, context) {
            count
        } else {
            self.share(decoder, count)?
        };
        self.cuboid(decoder, set, halves[0], lower, found)?;
        self.cuboid(decoder, set, halves[1], count - lower, found)
    }

    /// Reads how many of `count` points are in the lower half, if some are in both.
    fn share(&mut self, decoder: &mut RangeDecoder<'_>, count: usize) -> Option<usize> {
        let width = significant(count as u64 - 2);
        let mut less_one = 0;
        let mut node = 1;
        for bit in 0..width {
            let one = if bit < 3 {
                self.ask(decoder, Question::Share, [width.min(31), node, 0])
            } else {
                decoder.plain(1, 0) == 1
            };
            node = 2 * node + usize::from(one);
            less_one = 2 * less_one + usize::from(one);
        }
        (less_one + 1 < count).then_some(less_one + 1)
    }

    fn point(
        &mut self,
        decoder: &mut RangeDecoder<'_>,
        set: &SetLayout,
        Cuboid { low, size }: Cuboid,
        found: &[DecodedPoint],
    ) -> Option<Point> {
        let window = &found[found.len().saturating_sub(16)..];
        let centre: [i64; 3] = std::array::from_fn(|axis| i64::from(low[axis]) + (1_i64 << size[axis]) / 2);
        // The first one wins among equals.
        let near = window.iter().min_by_key(|found| distance(&found.point.0, &centre));
        let steep = near.map_or(0, |near| steepest(&near.direction));
        let mut coord = low;
        for axis in [(steep + 1) % 3, (steep + 2) % 3] {
            coord[axis] += decoder.plain(size[axis], 0);
        }
        let plane = near.map_or(centre[steep], |near| near.plane_at(steep, &coord));
        for half in (0..size[steep]).rev() {
            // Halves of the box are 2^half nodes. `quarters` is the height of the plane above the middle, in quarters
            // of a half, rounded.
            let middle = i64::from(coord[steep]) + (1 << half);
            let quarters = (8 * (plane - middle) + 4).div_euclid(2 << half).clamp(-8, 8);
            let context = [(quarters + 8) as usize, half.min(7) as usize, 0];
            if self.ask(decoder, Question::Above, context) {
                coord[steep] += 1 << half;
            }
        }
        let inside = (0..3).all(|axis| coord[axis] <= set.extent[axis]);
        if !inside {
            return None;
        }
        let (normal, source, expected) = self.normal(decoder, set, &coord, window)?;
        let chart = self.chart(decoder, set, source, expected)?;
        Some((coord, normal, chart))
    }

    fn normal(
        &mut self,
        decoder: &mut RangeDecoder<'_>,
        set: &SetLayout,
        coord: &[u32; 3],
        window: &[DecodedPoint],
    ) -> Option<FoundNormal> {
        // The best first; among equals the last one decoded.
        let mut candidates: Vec<(u64, u64, u16, u32)> = window
            .iter()
            .rev()
            .map(|found| {
                let plane_distance = found.plane_distance(coord);
                let cost = distance(&found.point.0, &coord.map(i64::from)) + 4 * plane_distance;
                (cost, plane_distance, found.point.1, found.point.2)
            })
            .collect();
        candidates.sort_by_key(|candidate| candidate.0);
        let first = candidates.first().copied();
        let second = first.and_then(|first| candidates.iter().find(|other| other.2 != first.2).copied());
        let class = |plane_distance: u64| significant(plane_distance).min(3);
        let expected = |of: Option<(u64, u64, u16, u32)>| of.map(|of| (class(of.1), of.3));
        if let Some((_, plane_distance, normal, _)) = first {
            let context = [usize::from(self.was_same), class(plane_distance), 0];
            self.was_same = self.ask(decoder, Question::SameAsFirst, context);
            if self.was_same {
                return Some((normal, 0, expected(first)));
            }
        }
        if let Some((_, plane_distance, normal, _)) = second
            && self.ask(decoder, Question::SameAsSecond, [class(plane_distance), 0, 0])
        {
            return Some((normal, 1, expected(second)));
        }
        let levels = 1 << set.normal_bits;
        let base = first.map_or(0, |first| i64::from(first.2));
        let u = base % levels + i64::from(self.turn[0].code_signed(decoder, 0));
        let v = base / levels + i64::from(self.turn[1].code_signed(decoder, 0));
        let sound = (0..levels).contains(&u) && (0..levels).contains(&v);
        sound.then_some(((u + v * levels) as u16, 2, expected(first)))
    }

    /// Reads a chart. `expected` is the class of the misfit of a candidate, and its chart.
    fn chart(
        &mut self,
        decoder: &mut RangeDecoder<'_>,
        set: &SetLayout,
        source: usize,
        expected: Option<(usize, u32)>,
    ) -> Option<u32> {
        if set.charts == 1 {
            return Some(0);
        }
        let (class, guess) = expected.unwrap_or_default();
        let context = [source, class, usize::from(self.was_alike)];
        self.was_alike = self.ask(decoder, Question::ExpectedChart, context);
        if self.was_alike {
            return Some(guess);
        }
        let chart = i64::from(guess) + i64::from(self.jump.code_signed(decoder, 0));
        (0..i64::from(set.charts)).contains(&chart).then_some(chart as u32)
    }
}

impl DecodedPoint {
    /// Returns where this point's plane is along an axis, at a place given by its other two coordinates; at most 2^24
    /// away.
    fn plane_at(&self, axis: usize, coord: &[u32; 3]) -> i64 {
        let own = self.point.0.map(i64::from);
        let mut fall = 0;
        for other in (0..3).filter(|other| *other != axis) {
            fall += self.direction[other] * (i64::from(coord[other]) - own[other]);
        }
        let down = fall.checked_div(self.direction[axis]).unwrap_or(0);
        own[axis] - down.clamp(-(1 << 24), 1 << 24)
    }

    /// Returns the distance of a place from this point's plane.
    fn plane_distance(&self, coord: &[u32; 3]) -> u64 {
        let axis = steepest(&self.direction);
        self.plane_at(axis, coord).abs_diff(coord[axis].into())
    }
}

fn distance(a: &[u32; 3], b: &[i64; 3]) -> u64 {
    (0..3).map(|axis| i64::from(a[axis]).abs_diff(b[axis])).max().unwrap_or(0)
}

/// Returns the first of the axes along which a box is longest.
fn first_longest(size: [u32; 3]) -> usize {
    (0..3).find(|axis| size.iter().all(|other| size[*axis] >= *other)).unwrap_or(0)
}

fn steepest(direction: &[i64; 3]) -> usize {
    first_longest(direction.map(|axis| axis.unsigned_abs() as u32))
}

/// Returns the direction of an octahedral code, not of unit length.
fn direction(normal_bits: u8, code: u16) -> [i64; 3] {
    let levels = 1 << normal_bits;
    let u = 2 * (i64::from(code) % levels) - (levels - 1);
    let v = 2 * (i64::from(code) / levels) - (levels - 1);
    let z = levels - 1 - u.abs() - v.abs();
    if z >= 0 {
        return [u, v, z];
    }
    let away = |axis: i64| if axis >= 0 { axis + z } else { axis - z };
    [away(u), away(v), z]
}
