//! Scan of the depth field along the lines of one direction, and prefix sums across them (Timonen, Algorithm 1 and
//! sections 6 and 7).

use glam::Vec2;
use rayon::prelude::*;

use super::field::DepthField;
use super::lines::{Row, ScanLines};

/// The largest heights of a line in an interval along the receiver angles of section 6, in metres.
///
/// The height of a point is minus its depth. The paper scans once for each direction of receivers. A scan that keeps
/// both downward angles serves two opposite directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Peak {
    /// `m_0`: along the horizontal.
    pub(crate) level: f32,
    /// `m_1`: downwards at 45 degrees, along the lines and against them.
    pub(crate) down: [f32; 2],
}

impl Peak {
    const NONE: Self = Self { level: f32::NEG_INFINITY, down: [f32::NEG_INFINITY; 2] };

    #[inline]
    fn max(self, other: Self) -> Self {
        Self {
            level: self.level.max(other.level),
            down: [self.down[0].max(other.down[0]), self.down[1].max(other.down[1])],
        }
    }

    /// Returns the virtual point at which the receiver angles meet (figure 5, right): (metres along the direction of
    /// `sense`, depth in metres); `None` where there is only sky.
    ///
    /// Line 14 of Algorithm 2 has `(m_0 - m_1) / s` for the first. By line 12 of Algorithm 1, `m_1` is `m_0 + s x`, so
    /// it must be `(m_1 - m_0) / s`. Here the slope s is 1, and x counts along the view.
    #[inline]
    pub(crate) fn point(self, sense: Sense) -> Option<Vec2> {
        (self.level > f32::NEG_INFINITY)
            .then(|| Vec2::new(self.down[sense as usize] - self.level, -self.level))
    }
}

/// Direction of a receiver's view along a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sense {
    Ahead = 0,
    Behind = 1,
}

impl Sense {
    pub(crate) const BOTH: [Self; 2] = [Self::Ahead, Self::Behind];

    #[inline]
    pub(crate) fn sign(self) -> f32 {
        match self {
            Self::Ahead => 1.0,
            Self::Behind => -1.0,
        }
    }
}

/// The intermediate geometry of one direction: peaks of all levels, and their prefix sums.
#[derive(Clone, Debug)]
pub(crate) struct Scan {
    lines: ScanLines,
    levels: Vec<ScanLevel>,
}

#[derive(Clone, Debug)]
struct ScanLevel {
    /// Index of the first peak of each row.
    offsets: Vec<usize>,
    peaks: Vec<Peak>,
    /// Prefix sums over the lines of `level`, both of `down`, and the number of lines with a peak. Each row has one
    /// more sum than peaks. Empty until [`Scan::sum`].
    sums: Vec<[f64; 4]>,
}

impl Scan {
    /// Scans `field` along `lines`, row by row on all threads, and pairs intervals.
    pub(crate) fn new(field: &DepthField, lines: ScanLines) -> Self {
        let mut levels: Vec<ScanLevel> = Vec::with_capacity(lines.levels().len());
        for (number, rows) in lines.levels().iter().enumerate() {
            let offsets: Vec<usize> = rows
                .iter()
                .scan(0, |offset, row| Some(std::mem::replace(offset, *offset + row.len as usize)))
                .collect();
            let count: usize = rows.iter().map(|row| row.len as usize).sum();
            let mut peaks = vec![Peak::NONE; count];
            let parts = split(&mut peaks, rows.iter().map(|row| row.len as usize));
            let below = number.checked_sub(1).map(|below| (&lines.levels()[below], &levels[below]));
            parts.into_par_iter().enumerate().for_each(|(index, peaks)| match below {
                None => scan_row(field, &lines, index as u32, rows[index], peaks),
                Some((rows_below, below)) => pair_up(rows_below, below, index, rows[index], peaks),
            });
            levels.push(ScanLevel { offsets, peaks, sums: Vec::new() });
        }
        Self { lines, levels }
    }

    /// Makes prefix sums of each row over its lines, so that averages over any range of lines take constant time.
    pub(crate) fn sum(&mut self) {
        for (level, rows) in self.levels.iter_mut().zip(self.lines.levels()) {
            level.sums = vec![[0.0; 4]; level.peaks.len() + rows.len()];
            let parts = split(&mut level.sums, rows.iter().map(|row| row.len as usize + 1));
            let (offsets, peaks) = (&level.offsets, &level.peaks);
            parts.into_par_iter().enumerate().for_each(|(index, sums)| {
                let mut sum = [0.0; 4];
                for (out, peak) in sums[1..].iter_mut().zip(&peaks[offsets[index]..]) {
                    if peak.level > f32::NEG_INFINITY {
                        let [ahead, behind] = peak.down.map(f64::from);
                        for (sum, value) in sum.iter_mut().zip([f64::from(peak.level), ahead, behind, 1.0]) {
                            *sum += value;
                        }
                    }
                    *out = sum;
                }
            });
        }
    }

    pub(crate) fn lines(&self) -> &ScanLines {
        &self.lines
    }

    /// Returns the size of all levels on the heap in bytes.
    pub(crate) fn heap_bytes(&self) -> usize {
        let level = |level: &ScanLevel| {
            size_of_val(level.offsets.as_slice())
                + size_of_val(level.peaks.as_slice())
                + size_of_val(level.sums.as_slice())
        };
        self.levels.iter().map(level).sum()
    }

    /// Returns the virtual point of the line nearest to `line` in interval `row` of `level`.
    #[inline]
    pub(crate) fn nearest(&self, level: usize, row: usize, line: f32, sense: Sense) -> Option<Vec2> {
        let Row { first, len } = self.lines.levels()[level][row];
        let index = (line + 0.5).floor() - first as f32;
        if !(index >= 0.0 && index < len as f32) {
            return None;
        }
        let level = &self.levels[level];
        level.peaks[level.offsets[row] + index as usize].point(sense)
    }

    /// Returns the average virtual point of interval `row` of `level` over the lines from `from` to `to`, and the share
    /// of that width with a surface.
    ///
    /// Lines count by their part between the two (section 7). Lines off the screen and lines with only sky are left out
    /// of the average and of the share. [`Scan::sum`] must have been called before; `from` is below `to`.
    #[inline]
    pub(crate) fn average(
        &self,
        level: usize,
        row: usize,
        from: f32,
        to: f32,
        sense: Sense,
    ) -> Option<(Vec2, f32)> {
        /// Smallest share of a sector that counts.
        const LEAST_SHARE: f64 = 1e-3;
        let Row { first, len } = self.lines.levels()[level][row];
        let level = &self.levels[level];
        // Each row before has one more sum than peaks.
        let offset = level.offsets[row] + row;
        let sums = &level.sums[offset..=offset + len as usize];
        // Line n lies between the edges n - 1/2 and n + 1/2.
        let edge = |line: f32| (line + 0.5 - first as f32).clamp(0.0, len as f32);
        let [start, end] = [edge(from), edge(to)].map(|at| {
            let below = at as usize;
            let (part, next) = (f64::from(at - below as f32), sums[(below + 1).min(len as usize)]);
            let sum = sums[below];
            [0, 1, 2, 3].map(|i| sum[i] + (next[i] - sum[i]) * part)
        });
        let count = end[3] - start[3];
        let share = count / f64::from(to - from);
        if share < LEAST_SHARE {
            return None;
        }
        let peak = (end[0] - start[0]) / count;
        let down = sense as usize + 1;
        let down = (end[down] - start[down]) / count;
        Some((Vec2::new((down - peak) as f32, -peak as f32), share.min(1.0) as f32))
    }
}

/// Scans one interval of all its lines (Algorithm 1).
fn scan_row(field: &DepthField, lines: &ScanLines, index: u32, row: Row, peaks: &mut [Peak]) {
    let across = lines.along.perp();
    let slope = field.pixels().slope();
    let steps = index * lines.interval(0)..(index + 1) * lines.interval(0);
    for (peak, line) in peaks.iter_mut().zip(row.first..) {
        for step in steps.clone() {
            let at = lines.sample(step, line);
            let inverse = field.inverse(lines.along * at.x + across * at.y);
            if inverse > 0.0 {
                let depth = 1.0 / inverse;
                let along = depth * (at.x * slope);
                *peak = peak.max(Peak { level: -depth, down: [along - depth, -along - depth] });
            }
        }
    }
}

/// Computes one interval of a higher level: the maxima of the two intervals below.
fn pair_up(rows_below: &[Row], below: &ScanLevel, index: usize, row: Row, peaks: &mut [Peak]) {
    for child in (2 * index..2 * index + 2).filter(|child| *child < rows_below.len()) {
        let Row { first, len } = rows_below[child];
        if len == 0 {
            continue;
        }
        let to = (first - row.first) as usize;
        let from = below.offsets[child];
        for (peak, other) in peaks[to..].iter_mut().zip(&below.peaks[from..from + len as usize]) {
            *peak = peak.max(*other);
        }
    }
}

/// Cuts `data` into parts of these lengths.
fn split<T>(mut data: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    lengths
        .map(|length| {
            let (part, rest) = std::mem::take(&mut data).split_at_mut(length);
            data = rest;
            part
        })
        .collect()
}
