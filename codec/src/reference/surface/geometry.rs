//! GEOMETRY sections: points of sets that arrive.

use std::sync::Arc;

use super::curve::place;
use super::geometry_coder::GeometryDecoder;
use super::{Block, ByteReader, ReferenceError, rule};
use crate::surface::{Geometry, SetLayout, State};
use crate::wire::words;

/// A node of a set's lattice, a normal's code and a chart.
pub(super) type Point = ([u32; 3], u16, u32);

/// Reads a GEOMETRY section into `next`.
pub(super) fn read(
    next: &mut State,
    block: Block<'_>,
    models: &mut GeometryDecoder,
) -> Result<(), ReferenceError> {
    let mut left = block.section.records;
    let mut plain_bytes = 0;
    if let Some(mut decoder) = block.decoder() {
        let mut set = 0_i64;
        for _ in 0..models.numbers.code(&mut decoder, 0) {
            set += i64::from(models.numbers.code_signed(&mut decoder, 0));
            let layout = announce(next, set, &mut left)?;
            let points = models.points(&mut decoder, &layout).ok_or(ReferenceError::Rule)?;
            plain_bytes += 4 + 14 * points.len();
            arrive(next, set, layout, points)?;
            set += 1;
        }
        block.end(decoder, plain_bytes)?;
    } else {
        let raw = block.raw()?;
        let mut bytes = ByteReader(&raw);
        while bytes.end().is_err() {
            let [set] = words(bytes.take(4)?);
            let layout = announce(next, set.into(), &mut left)?;
            let points = read_plain(&mut bytes, &layout)?;
            for level in levels(&layout) {
                rule(points[level].is_sorted_by_key(order))?;
            }
            arrive(next, set.into(), layout, points)?;
        }
    }
    rule(left == 0)
}

/// Announces a set. It must not be here yet, and must have at most `left` points.
fn announce(next: &mut State, set: i64, left: &mut u32) -> Result<SetLayout, ReferenceError> {
    let set = usize::try_from(set).map_err(|_| ReferenceError::Rule)?;
    let layout = *next.layout().sets().get(set).ok_or(ReferenceError::Rule)?;
    rule(layout.points > 0 && !next.received[set])?;
    *left = left.checked_sub(layout.points).ok_or(ReferenceError::Rule)?;
    Ok(layout)
}

fn arrive(
    next: &mut State,
    set: i64,
    layout: SetLayout,
    mut points: Vec<Point>,
) -> Result<(), ReferenceError> {
    for level in levels(&layout) {
        points[level].sort_by_key(order);
    }
    let coords = points.iter().map(|point| point.0).collect();
    let normals = points.iter().map(|point| point.1).collect();
    let charts = points.iter().map(|point| point.2).collect();
    let geometry = Geometry::ordered(layout, coords, normals, charts);
    rule(geometry.digest() == layout.digest)?;
    next.received.set(set as usize, true);
    next.geometry[set as usize] = Some(Arc::new(geometry));
    Ok(())
}

/// Returns what orders the points of a level.
fn order((coord, normal, chart): &Point) -> (u64, u16, u32) {
    (place(*coord, 21), *normal, *chart)
}

/// Returns the points of each level of a set.
pub(super) fn levels(set: &SetLayout) -> Vec<std::ops::Range<usize>> {
    let mut ends: Vec<usize> = set.levels.ends().iter().map(|end| *end as usize).collect();
    ends.push(set.points as usize);
    let starts = std::iter::once(0).chain(ends.clone());
    starts.zip(&ends).map(|(start, end)| start..*end).collect()
}

/// Reads one set of the plain layout: nine planes of coordinates, two of normals, three of charts.
fn read_plain(bytes: &mut ByteReader<'_>, layout: &SetLayout) -> Result<Vec<Point>, ReferenceError> {
    let count = layout.points as usize;
    let mut planes = Vec::new();
    for _ in 0..14 {
        planes.push(bytes.take(count)?);
    }
    let number = |planes: &[&[u8]], point: usize| {
        planes.iter().rev().fold(0_u32, |sum, plane| 256 * sum + u32::from(plane[point]))
    };
    let mut points: Vec<Point> = Vec::new();
    for point in 0..count {
        let (before, _, chart_before) = points.last().copied().unwrap_or_default();
        let coord: [u32; 3] = std::array::from_fn(|axis| {
            (before[axis] + number(&planes[3 * axis..3 * axis + 3], point)) % (1 << 24)
        });
        let normal = number(&planes[9..11], point);
        rule((0..3).all(|axis| coord[axis] <= layout.extent[axis]))?;
        rule(normal < 1 << (2 * layout.normal_bits))?;
        let chart = (chart_before + number(&planes[11..14], point)) % (1 << 24);
        rule(chart < layout.charts)?;
        points.push((coord, normal as u16, chart));
    }
    Ok(points)
}
