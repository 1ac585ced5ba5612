//! GEOMETRY sections: sets and their points.
//!
//! The plain layout is, set after set: u32 set; for x, y and z in turn, the differences of the coordinates from those
//! of the point before (for the first point, from 0) as 24-bit numbers that wrap, in three planes of bytes, low bytes
//! first; then the codes of the normals in two planes of bytes, low bytes first; then the differences of the charts like
//! those of a coordinate. The layout has the number of points of a set.

use std::sync::Arc;

use bitvec::vec::BitVec;

use crate::range::{BinaryCoder, NumberModel};
use crate::surface::geometry::{CodedPoint, Geometry, OrderKey};
use crate::surface::model::geometry::GeometryModel;
use crate::surface::{Layout, SetLayout};
use crate::wire::Reader;

/// Sets and their points.
pub(crate) type Sets = Vec<(u32, Arc<Geometry>)>;

/// Why a GEOMETRY section was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometrySectionError {
    /// The section ends early.
    #[error("it ends after {points} points of a set")]
    Ends {
        /// Number of points read.
        points: usize,
    },
    /// A set is not in the layout, has no points, or was already received.
    #[error("set {set} is not part of the stream, has no points, or was already received")]
    Set {
        /// The set.
        set: u32,
    },
    /// A coordinate is outside the lattice of the set.
    #[error("a point at node {coord:?} is outside its lattice")]
    Outside {
        /// Its coordinates.
        coord: [u32; 3],
    },
    /// The points of a level are not in order.
    #[error("point {point} of a set is out of order")]
    Order {
        /// The point.
        point: usize,
    },
    /// The code of a normal has too many bits.
    #[error("a normal has the code {axes:?}")]
    Normal {
        /// The codes of both axes.
        axes: [i32; 2],
    },
    /// A chart is not one of the set's.
    #[error("a point has chart {chart}, but its set has {charts}")]
    Chart {
        /// Its chart.
        chart: u32,
        /// Number of charts of the set.
        charts: u32,
    },
    /// More points are in a half than in the whole.
    #[error("half of a box claims {share} + 1 points, but the box holds only {count}")]
    Share {
        /// Number of points in the half minus 1.
        share: usize,
        /// Number of points in the box.
        count: usize,
    },
    /// The points differ from those that the layout names.
    #[error("set {set}: the digest of the points differs from the stream's")]
    Digest {
        /// The set.
        set: u32,
    },
    /// The number of points differs from the section table.
    #[error("{found} points, the section table says {expected}")]
    Count {
        /// Number by the section table.
        expected: u32,
        /// Number in the section.
        found: u64,
    },
}

/// Length of a point in the plain layout, bytes.
const POINT_BYTES: usize = 14;

/// Returns the length of the plain layout in bytes.
pub(crate) fn plain_bytes(sets: &Sets) -> usize {
    sets.iter().map(|(_, geometry)| 4 + POINT_BYTES * geometry.len()).sum()
}

/// Appends the plain layout to `out`.
pub(crate) fn write_plain(sets: &Sets, out: &mut Vec<u8>) {
    for (set, geometry) in sets {
        out.extend_from_slice(&set.to_le_bytes());
        for axis in 0..3 {
            write_differences(geometry.coords.iter().map(|coord| coord[axis]), out);
        }
        for plane in 0..2 {
            out.extend(geometry.normals.iter().map(|normal| (normal >> (8 * plane)) as u8));
        }
        write_differences(geometry.charts.iter().copied(), out);
    }
}

/// Appends the differences of numbers from the one before, the first from 0, as three planes of bytes.
fn write_differences(numbers: impl Iterator<Item = u32> + Clone, out: &mut Vec<u8>) {
    let before = std::iter::once(0).chain(numbers.clone());
    let differences = numbers.zip(before).map(|(number, before)| number.wrapping_sub(before));
    for plane in 0..3 {
        out.extend(differences.clone().map(|difference| (difference >> (8 * plane)) as u8));
    }
}

/// Checks sets in the order in which they arrive.
struct SetCheck<'a> {
    layout: &'a Layout,
    expected: u32,
    points: u64,
    /// By set: whether it was announced. A set that came again and again would take memory without limit.
    announced: BitVec,
    sets: Sets,
}

impl<'a> SetCheck<'a> {
    fn new(layout: &'a Layout, expected: u32) -> SetCheck<'a> {
        let announced = BitVec::repeat(false, layout.sets().len());
        SetCheck { layout, expected, points: 0, announced, sets: Sets::new() }
    }

    /// Announces a set and counts its points. Returns its layout.
    fn announce(&mut self, set: u32) -> Result<&'a SetLayout, GeometrySectionError> {
        let layout = self.layout.sets().get(set as usize).filter(|layout| layout.points > 0);
        let layout = layout.ok_or(GeometrySectionError::Set { set })?;
        if self.announced.replace(set as usize, true) {
            return Err(GeometrySectionError::Set { set });
        }
        self.points += u64::from(layout.points);
        let (expected, found) = (self.expected, self.points);
        if found > u64::from(expected) {
            Err(GeometrySectionError::Count { expected, found })
        } else {
            Ok(layout)
        }
    }

    fn add(&mut self, set: u32, geometry: Geometry) -> Result<(), GeometrySectionError> {
        if geometry.digest() != geometry.layout().digest {
            return Err(GeometrySectionError::Digest { set });
        }
        self.sets.push((set, Arc::new(geometry)));
        Ok(())
    }

    fn end(self) -> Result<Sets, GeometrySectionError> {
        let (expected, found) = (self.expected, self.points);
        if found == u64::from(expected) {
            Ok(self.sets)
        } else {
            Err(GeometrySectionError::Count { expected, found })
        }
    }
}

/// Reads the plain layout: sets with `records` points in all.
pub(crate) fn read_plain(raw: &[u8], layout: &Layout, records: u32) -> Result<Sets, GeometrySectionError> {
    let mut incoming = SetCheck::new(layout, records);
    let mut reader = Reader::new(raw);
    while reader.remaining() > 0 {
        let set = reader.u32("the set").map_err(|_| GeometrySectionError::Ends { points: 0 })?;
        let set_layout = incoming.announce(set)?;
        let count = set_layout.points as usize;
        let left = reader.remaining();
        let ends = |_| GeometrySectionError::Ends { points: left / POINT_BYTES };
        let planes = reader.take("the points", POINT_BYTES * count).map_err(ends)?;
        incoming.add(set, read_set(planes, set_layout, count)?)?;
    }
    incoming.end()
}

fn read_set(planes: &[u8], layout: &SetLayout, count: usize) -> Result<Geometry, GeometrySectionError> {
    let byte = |plane: usize, point: usize| u32::from(planes[plane * count + point]);
    let difference = |first: usize, point: usize| {
        (0..3).fold(0, |sum, plane| sum | byte(first + plane, point) << (8 * plane))
    };
    let mut coord = [0_u32; 3];
    let mut chart = 0_u32;
    let mut points = Vec::with_capacity(count);
    let mut before = (0, OrderKey::default());
    for point in 0..count {
        for (axis, coord) in coord.iter_mut().enumerate() {
            *coord = coord.wrapping_add(difference(3 * axis, point)) & 0xFF_FFFF;
        }
        if (0..3).any(|axis| coord[axis] > layout.extent[axis]) {
            return Err(GeometrySectionError::Outside { coord });
        }
        let normal = (byte(9, point) | byte(10, point) << 8) as u16;
        if u32::from(normal) >> (2 * layout.normal_bits) != 0 {
            return Err(GeometrySectionError::Normal { axes: [normal.into(), 0] });
        }
        chart = chart.wrapping_add(difference(11, point)) & 0xFF_FFFF;
        if chart >= layout.charts {
            return Err(GeometrySectionError::Chart { chart, charts: layout.charts });
        }
        let coded = CodedPoint { coord, normal, chart };
        let key = (layout.levels.of_point(point as u32), coded.order_key());
        if key < before {
            return Err(GeometrySectionError::Order { point });
        }
        before = key;
        points.push(coded);
    }
    Ok(Geometry::sorted(*layout, &points))
}

/// Codes sets with `records` points in all.
pub(crate) fn code<B: BinaryCoder>(
    model: &mut GeometryModel,
    numbers: &mut NumberModel,
    coder: &mut B,
    layout: &Layout,
    source: &Sets,
    records: u32,
    stop: impl Fn(&B) -> bool,
) -> Result<Sets, GeometrySectionError> {
    let mut incoming = SetCheck::new(layout, records);
    let count = numbers.code(coder, source.len() as u32);
    let mut next = 0_u32;
    for at in 0..count as usize {
        let source_set = source.get(at);
        let gap = source_set.map_or(0, |(set, _)| set.wrapping_sub(next) as i32);
        let set = next.wrapping_add_signed(numbers.code_signed(coder, gap));
        let set_layout = incoming.announce(set)?;
        let geometry = model.code(coder, set_layout, source_set.map(|(_, geometry)| &**geometry), &stop)?;
        incoming.add(set, geometry)?;
        next = set.wrapping_add(1);
        if stop(coder) {
            return Err(GeometrySectionError::Ends { points: 0 });
        }
    }
    incoming.end()
}
