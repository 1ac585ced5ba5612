//! Model of geometry for the range coder. It halves a box again and again and codes how many points are in the lower
//! half (P.-M. Gandoin and O. Devillers, "Progressive lossless compression of arbitrary simplicial complexes", 2002).
//! So the order of the points costs no bits. A point alone in its box is predicted to lie in the plane of a point near
//! it, and to have its normal and its chart. The levels of a set follow each other, each with a box of its own.

use std::ops::Range;

use crate::range::{BinaryCoder, BitModel, NumberModel};
use crate::surface::geometry::{CodedPoint, Geometry};
use crate::surface::{GeometrySectionError, SetLayout};

/// Size of the window: the points coded last, from which the next one is predicted.
const WINDOW_POINTS: usize = 16;
/// Number of counts in a box with contexts of their own.
const COUNT_CLASSES: usize = 17;

/// What the coder has learned. Every frame starts a fresh model.
pub(crate) struct GeometryModel {
    /// By count, direction of the cut and size of the box: whether the lower half is empty, and whether the upper half
    /// is.
    empty: [Vec<BitModel>; 2],
    /// By class of the count: the first bits of the share of the lower half.
    share: Vec<BitModel>,
    /// By place of the predicted plane and size of the box: whether the point is in the upper half.
    plane: Vec<BitModel>,
    /// Whether the normal is that of the first candidate, and of the second.
    same: [Vec<BitModel>; 2],
    /// Differences of other normals.
    turn: [NumberModel; 2],
    /// By origin of the normal, misfit and `was_alike`: whether the chart is the expected one.
    chart: Vec<BitModel>,
    /// Differences of other charts.
    jump: NumberModel,
    recent: Vec<Point>,
    was_same: bool,
    /// Whether the last chart was the expected one.
    was_alike: bool,
}

/// A coded point.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Point {
    coord: [u32; 3],
    normal: u16,
    chart: u32,
    /// Its normal in whole numbers, not of unit length.
    direction: [i64; 3],
}

/// A point of the window that fits a place.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    normal: u16,
    chart: u32,
    /// Distance of the place from the point's plane, in nodes.
    misfit: u64,
}

impl Candidate {
    /// Returns the class of the misfit, of four.
    fn class(&self) -> usize {
        (64 - self.misfit.leading_zeros()).min(3) as usize
    }
}

/// Origin of a normal's code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NormalOrigin {
    First,
    Second,
    Own,
}

/// A box of the lattice. `size[axis]` is the logarithm of its edge.
#[derive(Debug, Clone, Copy)]
struct Cuboid {
    low: [u32; 3],
    size: [u32; 3],
    count: usize,
    /// Index of its first point in the encoder's list.
    first: usize,
}

impl Cuboid {
    /// Returns the axis along which it is cut: the longest, and the first of equal ones.
    fn axis(&self) -> usize {
        let longest = self.size.into_iter().max().unwrap_or(0);
        self.size.iter().position(|size| *size == longest).unwrap_or(0)
    }
}

impl GeometryModel {
    pub(crate) fn new() -> GeometryModel {
        let half = BitModel::new(1 << 15);
        GeometryModel {
            empty: [vec![half; COUNT_CLASSES * 2 * 8], vec![half; COUNT_CLASSES * 2 * 8]],
            share: vec![half; 32 * 8],
            plane: vec![half; 17 * 8],
            same: [vec![BitModel::new(1 << 15); 2 * 4], vec![half; 4]],
            turn: [NumberModel::new(), NumberModel::new()],
            chart: vec![half; 3 * 4 * 2],
            jump: NumberModel::new(),
            recent: Vec::with_capacity(WINDOW_POINTS),
            was_same: true,
            was_alike: true,
        }
    }

    /// Codes the points of a set. A decoder passes `None` as `source`.
    pub(crate) fn code<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &SetLayout,
        source: Option<&Geometry>,
        stop: impl Fn(&B) -> bool,
    ) -> Result<Geometry, GeometrySectionError> {
        let size = layout.extent.map(|extent| 32 - extent.leading_zeros());
        let list = source.map(|geometry| in_cutting_order(geometry, size)).unwrap_or_default();
        let mut coded = Vec::with_capacity(list.len());
        self.recent.clear();
        // The finest level is at the bottom of the stack. Levels without points cost nothing.
        let root = |points: Range<u32>| Cuboid {
            low: [0; 3],
            size,
            count: points.len(),
            first: points.start as usize,
        };
        let mut boxes: Vec<Cuboid> = layout.level_points().map(root).collect();
        boxes.reverse();
        while let Some(cuboid) = boxes.pop() {
            if stop(coder) {
                return Err(GeometrySectionError::Ends { points: coded.len() });
            }
            match (cuboid.count, cuboid.size) {
                (0, _) => {}
                (1, _) | (_, [0, 0, 0]) => {
                    for at in cuboid.first..cuboid.first + cuboid.count {
                        coded.push(self.point(coder, layout, &cuboid, list.get(at).copied())?);
                    }
                }
                _ => {
                    let (lower, upper) = self.cut(coder, &cuboid, &list)?;
                    boxes.push(upper);
                    boxes.push(lower);
                }
            }
        }
        Ok(Geometry::sorted(*layout, &coded))
    }

    /// Cuts a box in two halves.
    fn cut<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        cuboid: &Cuboid,
        list: &[CodedPoint],
    ) -> Result<(Cuboid, Cuboid), GeometrySectionError> {
        let axis = cuboid.axis();
        let mut lower = *cuboid;
        lower.size[axis] -= 1;
        let mut upper = lower;
        upper.low[axis] += 1 << lower.size[axis];
        let points = list.get(cuboid.first..cuboid.first + cuboid.count).unwrap_or_default();
        let source = points.partition_point(|point| point.coord[axis] < upper.low[axis]);
        lower.count = self.lower_count(coder, cuboid, axis, source)?;
        upper.count = cuboid.count - lower.count;
        upper.first = cuboid.first + lower.count;
        Ok((lower, upper))
    }

    /// Codes the number of points in the lower half of a box.
    fn lower_count<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        cuboid: &Cuboid,
        axis: usize,
        source: usize,
    ) -> Result<usize, GeometrySectionError> {
        let count = cuboid.count;
        let across = self.recent.last().is_some_and(|point| steepest(&point.direction) == axis);
        let class = count.min(COUNT_CLASSES - 1);
        let at = (class * 2 + usize::from(across)) * 8 + cuboid.size[axis].min(7) as usize;
        for (empty, all) in [(0, 0), (1, count)] {
            let model = &mut self.empty[empty][at];
            let is = coder.bit(model.one(), source == all);
            model.learn(is);
            if is {
                return Ok(all);
            }
        }
        // 1 to count - 1 remain.
        let width = usize::BITS - (count - 2).leading_zeros();
        let rest = source.wrapping_sub(1);
        let mut node = 1;
        let first = width.min(3);
        for bit in (width - first..width).rev() {
            let model = &mut self.share[(width.min(31) as usize) * 8 + node];
            let is = coder.bit(model.one(), rest >> bit & 1 == 1);
            model.learn(is);
            node = node << 1 | usize::from(is);
        }
        let low = coder.plain(width - first, (rest & ((1 << (width - first)) - 1)) as u32) as usize;
        let share = (node - (1 << first)) << (width - first) | low;
        if share + 1 < count { Ok(share + 1) } else { Err(GeometrySectionError::Share { share, count }) }
    }

    /// Codes a point that is alone in its box, or in a box of one node.
    fn point<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &SetLayout,
        cuboid: &Cuboid,
        source: Option<CodedPoint>,
    ) -> Result<CodedPoint, GeometrySectionError> {
        let source = source.unwrap_or_default();
        let Cuboid { low, size, .. } = *cuboid;
        let centre: [i64; 3] = std::array::from_fn(|a| i64::from(low[a]) + (1_i64 << size[a]) / 2);
        let near = self.recent.iter().copied().min_by_key(|point| distance(&point.coord, &centre));
        let steep = near.map_or(0, |point| steepest(&point.direction));
        let mut coord = low;
        for axis in [(steep + 1) % 3, (steep + 2) % 3] {
            coord[axis] += coder.plain(size[axis], source.coord[axis].wrapping_sub(low[axis]));
        }
        let plane = near.map_or(centre[steep], |point| point.plane_at(steep, &coord));
        coord[steep] = self.height(coder, low[steep], size[steep], plane, source.coord[steep]);
        if (0..3).any(|axis| coord[axis] > layout.extent[axis]) {
            return Err(GeometrySectionError::Outside { coord });
        }
        let candidates = self.candidates(&coord);
        let (normal, origin) = self.normal(coder, layout, candidates, source.normal)?;
        let expected = candidates[usize::from(origin == NormalOrigin::Second)];
        let chart = self.chart(coder, layout, origin, expected, source.chart)?;
        if self.recent.len() == WINDOW_POINTS {
            self.recent.remove(0);
        }
        self.recent.push(Point { coord, normal, chart, direction: direction(layout.normal_bits, normal) });
        Ok(CodedPoint { coord, normal, chart })
    }

    /// Codes one coordinate in `low .. low + 2^size`, which is probably near `plane`.
    fn height<B: BinaryCoder>(&mut self, coder: &mut B, low: u32, size: u32, plane: i64, source: u32) -> u32 {
        let mut low = low;
        for size in (0..size).rev() {
            let middle = low + (1 << size);
            // Height of the plane above the middle, in quarters of half the box.
            let above = ((plane - i64::from(middle)) * 8 + 4).div_euclid(2 << size).clamp(-8, 8) + 8;
            let model = &mut self.plane[above as usize * 8 + size.min(7) as usize];
            let upper = coder.bit(model.one(), source >= middle);
            model.learn(upper);
            if upper {
                low = middle;
            }
        }
        low
    }

    fn normal<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &SetLayout,
        [first, second]: [Option<Candidate>; 2],
        source: u16,
    ) -> Result<(u16, NormalOrigin), GeometrySectionError> {
        let same = |coder: &mut B, model: &mut BitModel, candidate: u16| {
            let is = coder.bit(model.one(), source == candidate);
            model.learn(is);
            is
        };
        if let Some(candidate) = first {
            let at = usize::from(self.was_same) * 4 + candidate.class();
            self.was_same = same(coder, &mut self.same[0][at], candidate.normal);
            if self.was_same {
                return Ok((candidate.normal, NormalOrigin::First));
            }
        }
        if let Some(candidate) = second
            && same(coder, &mut self.same[1][candidate.class()], candidate.normal)
        {
            return Ok((candidate.normal, NormalOrigin::Second));
        }
        let width = u32::from(layout.normal_bits);
        let mask = (1 << width) - 1;
        let base = first.map_or(0, |candidate| candidate.normal);
        let mut axes = [0_i32; 2];
        for (axis, shift) in [(0, 0), (1, width)] {
            let from = i32::from(base >> shift & mask);
            let to = i32::from(source >> shift & mask);
            axes[axis] = from.wrapping_add(self.turn[axis].code_signed(coder, to - from));
        }
        if axes.iter().any(|axis| !(0..=i32::from(mask)).contains(axis)) {
            return Err(GeometrySectionError::Normal { axes });
        }
        Ok(((axes[0] | axes[1] << width) as u16, NormalOrigin::Own))
    }

    /// Codes the chart of a point; `expected` is the window point whose chart it probably has.
    fn chart<B: BinaryCoder>(
        &mut self,
        coder: &mut B,
        layout: &SetLayout,
        origin: NormalOrigin,
        expected: Option<Candidate>,
        source: u32,
    ) -> Result<u32, GeometrySectionError> {
        if layout.charts == 1 {
            return Ok(0);
        }
        let guess = expected.map_or(0, |candidate| candidate.chart);
        let class = expected.map_or(0, |candidate| candidate.class());
        let model = &mut self.chart[(origin as usize * 4 + class) * 2 + usize::from(self.was_alike)];
        self.was_alike = coder.bit(model.one(), source == guess);
        model.learn(self.was_alike);
        if self.was_alike {
            return Ok(guess);
        }
        let chart =
            guess.wrapping_add_signed(self.jump.code_signed(coder, source.wrapping_sub(guess) as i32));
        if chart < layout.charts {
            Ok(chart)
        } else {
            Err(GeometrySectionError::Chart { chart, charts: layout.charts })
        }
    }

    /// Returns the two points, with different normals, that fit a place best: near it, and with it in their plane.
    fn candidates(&self, coord: &[u32; 3]) -> [Option<Candidate>; 2] {
        let at = coord.map(i64::from);
        let cost = |point: &Point| {
            let axis = steepest(&point.direction);
            let misfit = (point.plane_at(axis, coord) - at[axis]).unsigned_abs();
            let candidate = Candidate { normal: point.normal, chart: point.chart, misfit };
            (distance(&point.coord, &at).saturating_add(misfit.saturating_mul(4)), candidate)
        };
        // The last one coded wins among equals.
        let best = |left_out: Option<u16>| {
            let points = self.recent.iter().rev().filter(|point| Some(point.normal) != left_out);
            points.map(cost).min_by_key(|(cost, _)| *cost).map(|(_, candidate)| candidate)
        };
        let first = best(None);
        [first, first.and_then(|first| best(Some(first.normal)))]
    }
}

impl Point {
    /// Returns where the plane through this point is along `axis`, at a place given by its other two coordinates. The
    /// result is kept within 2^24 of the point, since a plane nearly parallel to the axis may be far away. `axis` is
    /// the steepest axis of the direction, which is never 0 along it.
    fn plane_at(&self, axis: usize, coord: &[u32; 3]) -> i64 {
        let own = i64::from(self.coord[axis]);
        let steepness = self.direction[axis];
        let fall: i64 = [(axis + 1) % 3, (axis + 2) % 3]
            .into_iter()
            .map(|other| self.direction[other] * (i64::from(coord[other]) - i64::from(self.coord[other])))
            .sum();
        own - (fall / steepness).clamp(-(1 << 24), 1 << 24)
    }
}

/// Returns the largest difference of a coordinate.
fn distance(a: &[u32; 3], b: &[i64; 3]) -> u64 {
    (0..3).map(|axis| (i64::from(a[axis]) - b[axis]).unsigned_abs()).max().unwrap_or(0)
}

/// Returns the axis along which a direction is longest, and the first of equal ones.
fn steepest(direction: &[i64; 3]) -> usize {
    let longest = direction.iter().map(|axis| axis.abs()).max().unwrap_or(0);
    direction.iter().position(|axis| axis.abs() == longest).unwrap_or(0)
}

/// Returns the direction of an octahedral code in whole numbers, not of unit length; see [`crate::quant::oct`].
fn direction(bits: u8, code: u16) -> [i64; 3] {
    let top = (1_i64 << bits) - 1;
    let [u, v] = [code & top as u16, code >> bits].map(|axis| 2 * i64::from(axis) - top);
    let z = top - u.abs() - v.abs();
    let fold = (-z).max(0);
    let folded = |axis: i64| if axis >= 0 { axis - fold } else { axis + fold };
    [folded(u), folded(v), z]
}

/// Returns the points, level by level, in the order in which they become alone in their boxes.
fn in_cutting_order(geometry: &Geometry, size: [u32; 3]) -> Vec<CodedPoint> {
    let key = |coord: &[u32; 3]| {
        let mut key = 0_u64;
        let mut cuboid = Cuboid { low: [0; 3], size, count: 0, first: 0 };
        while cuboid.size != [0; 3] {
            let axis = cuboid.axis();
            cuboid.size[axis] -= 1;
            key = key << 1 | u64::from(coord[axis] >> cuboid.size[axis] & 1);
        }
        key
    };
    let points = (0..geometry.len()).map(|point| (geometry.level(point), geometry.coords[point], point));
    let mut keyed: Vec<_> = points
        .map(|(level, coord, point)| {
            (level, key(&coord), geometry.normals[point], geometry.charts[point], coord)
        })
        .collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, _, normal, chart, coord)| CodedPoint { coord, normal, chart }).collect()
}
