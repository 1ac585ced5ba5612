//! The directions in which pixels gather obscurance, and the gathering (Timonen, Algorithm 2).

use glam::Vec2;

use super::field::DepthField;
use super::scan::{Scan, Sense};
use super::settings::FarFieldSettings;
use super::slice::{Estimator, Receiver, SlabPlacement, Slice};
use crate::reference::mix;

/// Number of angles that jittered pixels choose from.
const JITTERS: usize = 16;

/// A segment of a sector: a wedge of the screen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    sense: Sense,
    /// Unit vector along the lines in the direction of the segment's sector.
    outward: Vec2,
    /// Unit vector along the segment's middle, and the cosine of its angle to `outward`.
    along: Vec2,
    cos: f32,
    /// Lines to the right of `outward` per step, at the segment's sides and middle.
    sides: [f32; 2],
    middle: f32,
}

/// The segments of two opposite sectors, for each angle of jitter.
#[derive(Clone, Debug)]
pub(crate) struct Segments {
    segments: Vec<Segment>,
    /// Number of segments in both sectors.
    each: usize,
    seed: Option<u64>,
}

impl Segments {
    /// Makes the segments of the sectors along `along` and against it.
    pub(crate) fn new(settings: &FarFieldSettings, along: Vec2) -> Self {
        let width = std::f64::consts::TAU / f64::from(settings.sectors * settings.segments);
        let jitters = if settings.jitter.is_some() { JITTERS } else { 1 };
        let mut segments = Vec::new();
        for jitter in 0..jitters {
            // Angles are midpoints of equal parts of the segment. A single one is its middle.
            let turn = (jitter as f64 + 0.5) / jitters as f64 - 0.5;
            for sense in Sense::BOTH {
                let outward = along * sense.sign();
                for segment in 0..settings.segments {
                    let place = f64::from(segment) + 0.5 - 0.5 * f64::from(settings.segments) + turn;
                    let [middle, from, to] = [place, place - 0.5, place + 0.5].map(|place| place * width);
                    let (sin, cos) = (libm::sin(middle) as f32, libm::cos(middle) as f32);
                    segments.push(Segment {
                        sense,
                        outward,
                        along: outward * cos + outward.perp() * sin,
                        cos,
                        sides: [from, to].map(|angle| libm::tan(angle) as f32),
                        middle: libm::tan(middle) as f32,
                    });
                }
            }
        }
        Self { segments, each: 2 * settings.segments as usize, seed: settings.jitter }
    }

    /// Returns the segments of pixel number `pixel`.
    #[inline]
    pub(crate) fn of(&self, pixel: usize) -> &[Segment] {
        let jitter = self.seed.map_or(0, |seed| mix(seed ^ mix(pixel as u64)) as usize % JITTERS);
        &self.segments[jitter * self.each..(jitter + 1) * self.each]
    }
}

/// Returns the number of the first interval for a receiver `steps` steps along its line.
///
/// It is the nearest interval that is at least `density` times its length away (Algorithm 2, line 2, where that is 1).
/// A number below 0 or beyond the last interval means that there is none.
#[inline]
fn first_interval(steps: f32, interval: f32, density: f32, sense: Sense) -> i32 {
    match sense {
        Sense::Ahead => (steps / interval + density).ceil() as i32,
        Sense::Behind => (steps / interval - density).floor() as i32 - 1,
    }
}

/// Returns the steps from a receiver to the near end of an interval.
#[inline]
fn near_end(steps: f32, row: i32, interval: f32, sense: Sense) -> f32 {
    match sense {
        Sense::Ahead => row as f32 * interval - steps,
        Sense::Behind => steps - (row + 1) as f32 * interval,
    }
}

/// Inputs that all pixels share while they gather in one pair of opposite sectors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gather<'a> {
    pub(crate) field: &'a DepthField,
    pub(crate) scan: &'a Scan,
    pub(crate) estimator: Estimator<'a>,
    /// Whether slabs of intervals stand midway.
    pub(crate) midway: bool,
    /// Smallest distance of an interval in units of its length.
    pub(crate) density: f32,
}

impl Gather<'_> {
    /// Returns the obscurance of a receiver at `at`, in square pixels, by the intervals of the scan.
    ///
    /// It is over the integral of Eq. 2 and times pi over the segment's width. `horizon` is the horizon after the near
    /// field.
    pub(crate) fn far(
        &self,
        receiver: &Receiver,
        slice: &Slice,
        segment: &Segment,
        at: Vec2,
        horizon: &mut Vec2,
    ) -> f32 {
        let Segment { sense, outward, along, cos, sides, middle } = *segment;
        let lines = self.scan.lines();
        let place = lines.place(at);
        // Slopes per step along the segment's middle.
        let step = self.field.pixels().slope() / cos;
        let reach = slice.reach(self.estimator.table.radius()) / step;
        // The columns take (metres along the lines, depth) to a vector in the segment's slice, at an angle to the
        // lines.
        let [across, depth] = slice.axes();
        let slope = receiver.slope();
        let start = slope.dot(along);
        let columns = [across / cos, depth + across * (start - slope.dot(outward) / cos)];
        let mut hidden = 0.0;
        let mut level = 0;
        let mut row = first_interval(place.x, lines.interval(0) as f32, self.density, sense);
        while let Some(rows) = lines.levels().get(level)
            && row >= 0
            && (row as usize) < rows.len()
        {
            let interval = lines.interval(level) as f32;
            let near = near_end(place.x, row, interval, sense);
            if near >= reach {
                break;
            }
            let distance = near + 0.5 * interval;
            let line = |side: f32| place.y + sense.sign() * side * distance;
            let met = if self.estimator.thickness.is_some() {
                self.scan.nearest(level, row as usize, line(middle), sense).map(|point| (point, 1.0))
            } else {
                let [a, b] = sides.map(line);
                // At least one line wide.
                let (centre, half) = (0.5 * (a + b), (0.5 * (b - a).abs()).max(0.5));
                self.scan.average(level, row as usize, centre - half, centre + half, sense)
            };
            if let Some((point, share)) = met {
                let top = columns[0] * point.x + columns[1] * point.y;
                let stand = if self.midway {
                    SlabPlacement::Midway(across * (start + near * step) + depth)
                } else {
                    SlabPlacement::Top
                };
                hidden += self.estimator.add(slice, horizon, top, stand, share);
            }
            row += sense.sign() as i32;
            // The next level follows once one of its intervals begins here and is far enough away (section 6), up to
            // rounding.
            if level + 1 < lines.levels().len()
                && (row & 1 == 1) == (sense == Sense::Behind)
                && near + 1.01 * interval >= self.density * 2.0 * interval
            {
                row >>= 1;
                level += 1;
            }
        }
        hidden
    }

    /// Returns the obscurance by single samples between the receiver and the first interval, at rising `distances` in
    /// square pixels.
    pub(crate) fn near(
        &self,
        receiver: &Receiver,
        slice: &Slice,
        segment: &Segment,
        at: Vec2,
        distances: &[f32],
        horizon: &mut Vec2,
    ) -> f32 {
        let lines = self.scan.lines();
        let steps = lines.place(at).x;
        let interval = lines.interval(0) as f32;
        let first = first_interval(steps, interval, self.density, segment.sense);
        let slope = self.field.pixels().slope();
        let end = near_end(steps, first, interval, segment.sense) / segment.cos;
        let end = end.min(slice.reach(self.estimator.table.radius()) / slope);
        let [across, depth] = slice.axes();
        let start = receiver.slope().dot(segment.along);
        let mut hidden = 0.0;
        // Line of sight and inverse depth of the sample before.
        let (mut front, mut before) = (across * start + depth, 1.0 / receiver.depth());
        for &distance in distances.iter().take_while(|distance| **distance < end) {
            let inverse = self.field.inverse(at + segment.along * distance);
            let sight = across * (start + distance * slope) + depth;
            if inverse > 0.0 {
                let joined = self.field.joins(before, inverse);
                let stand = if joined { SlabPlacement::Joined(front / before) } else { SlabPlacement::Top };
                hidden += self.estimator.add(slice, horizon, sight / inverse, stand, 1.0);
            }
            (front, before) = (sight, inverse);
        }
        hidden
    }
}

impl Segment {
    /// Returns the slice of the segment's middle.
    #[inline]
    pub(crate) fn slice(&self, receiver: &Receiver) -> Slice {
        Slice::new(receiver, self.along)
    }
}
