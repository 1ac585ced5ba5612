//! The scan lines of one direction (Timonen, section 6, figure 4).
//!
//! Lines are parallel, one pixel apart, and sampled once a pixel. They are cut into intervals of `B_0` steps, at the
//! same places on all lines. Two intervals make one of the next level. A row is one interval of all the lines that
//! cross the screen there. Memory holds rows, so that parts of a slanted line off the screen take none.

use glam::Vec2;

use super::SquarePixels;

/// The lines of one direction over the whole grid, guard band included.
#[derive(Clone, Debug)]
pub(crate) struct ScanLines {
    /// Unit vector along the lines, in square pixels.
    pub(crate) along: Vec2,
    /// Steps from the middle of the grid to the start of the first interval, and lines to the first line; negative.
    start: Vec2,
    /// Steps of the shortest interval.
    interval: u32,
    /// Rows of all levels; the first level holds the shortest intervals.
    levels: Vec<Vec<Row>>,
}

/// An interval of all the lines that cross the screen there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Row {
    /// Number of the first line.
    pub(crate) first: u32,
    /// Number of lines.
    pub(crate) len: u32,
}

impl ScanLines {
    /// Lays lines along `along` over `pixels`, with intervals of `interval` steps.
    pub(crate) fn new(pixels: &SquarePixels, along: Vec2, interval: u32) -> Self {
        let half = pixels.half();
        let corners = [half, Vec2::new(-half.x, half.y), -half, Vec2::new(half.x, -half.y)]
            .map(|corner| Vec2::new(corner.dot(along), along.perp_dot(corner)));
        let reach = corners.into_iter().fold(Vec2::ZERO, Vec2::max);
        let start = -reach;
        let count = ((2.0 * reach.x) / interval as f32).ceil().max(1.0) as u32;
        let base: Vec<Row> = (0..count)
            .map(|row| {
                let from = start.x + (row * interval) as f32;
                row_between(&corners, from, from + interval as f32, start.y)
            })
            .collect();
        let mut levels = vec![base];
        while let Some(below) = levels.last().filter(|below| below.len() > 1) {
            let above =
                below.chunks(2).map(|pair| pair.iter().copied().reduce(Row::union).unwrap_or(pair[0]));
            let above = above.collect();
            levels.push(above);
        }
        Self { along, start, interval, levels }
    }

    /// Converts a place in square pixels from the grid's middle to (steps from the start of the first interval, lines
    /// from the first line). The middle of line number n is at n.
    #[inline]
    pub(crate) fn place(&self, at: Vec2) -> Vec2 {
        Vec2::new(at.dot(self.along), self.along.perp_dot(at)) - self.start - Vec2::new(0.0, 0.5)
    }

    /// Returns the middle of a step of a line in square pixels from the grid's middle: (along the lines, across them).
    #[inline]
    pub(crate) fn sample(&self, step: u32, line: u32) -> Vec2 {
        self.start + Vec2::new(step as f32 + 0.5, line as f32 + 0.5)
    }

    /// Returns the rows of all levels, the shortest intervals first.
    pub(crate) fn levels(&self) -> &[Vec<Row>] {
        &self.levels
    }

    /// Returns the number of steps in an interval of `level`.
    #[inline]
    pub(crate) fn interval(&self, level: usize) -> u32 {
        self.interval << level
    }
}

impl Row {
    /// Returns the smallest row that contains both.
    fn union(self, other: Self) -> Self {
        if self.len == 0 || other.len == 0 {
            return if self.len == 0 { other } else { self };
        }
        let first = self.first.min(other.first);
        Self { first, len: (self.first + self.len).max(other.first + other.len) - first }
    }
}

/// Returns the lines that cross the convex polygon of `corners`, (along, across), between two places along. Line 0
/// begins at `start`.
fn row_between(corners: &[Vec2; 4], from: f32, to: f32, start: f32) -> Row {
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    for (index, &a) in corners.iter().enumerate() {
        let b = corners[(index + 1) % 4];
        let (a, b) = if a.x <= b.x { (a, b) } else { (b, a) };
        if b.x < from || a.x > to {
            continue;
        }
        let across = |x: f32| a.y + (b.y - a.y) * ((x - a.x) / (b.x - a.x));
        let ends = if b.x > a.x { [a.x.max(from), b.x.min(to)].map(across) } else { [a.y, b.y] };
        for y in ends {
            least = least.min(y);
            most = most.max(y);
        }
    }
    if least > most {
        return Row { first: 0, len: 0 };
    }
    let first = (least - start).floor().max(0.0) as u32;
    Row { first, len: ((most - start).ceil() as u32).saturating_sub(first) }
}
