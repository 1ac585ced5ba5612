//! One slice of the hemisphere over a receiver: the estimator of Timonen, section 4.
//!
//! A slice is a half plane through the receiver and the eye. Vectors in it are (along the zenith, to the side), the
//! zenith being the way to the eye. Angles are compared by cross products and never computed.

use glam::{Vec2, Vec3};

use super::table::ObscuranceTable;

/// A pixel that obscurance is gathered for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Receiver {
    /// View space, metres.
    pub(crate) position: Vec3,
    /// Unit normal, view space.
    pub(crate) normal: Vec3,
    /// Distance from the eye in metres.
    distance: f32,
}

impl Receiver {
    pub(crate) fn new(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, distance: position.length() }
    }

    /// Metres from the eye's own plane.
    pub(crate) fn depth(&self) -> f32 {
        self.position.z
    }

    /// Slope at which the receiver is seen: its place on a screen one metre away.
    pub(crate) fn slope(&self) -> Vec2 {
        self.position.truncate() / self.position.z
    }
}

/// A half plane through a receiver and the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slice {
    /// Distance of receiver and eye.
    distance: f32,
    /// Scales depths onto the plane, which is slanted (`zScale` of Algorithm 2).
    slant: f32,
    /// Unit vectors of the plane in its axes (along the screen, towards the eye's own plane).
    zenith: Vec2,
    side: Vec2,
    /// The normal, projected onto the plane and not normalised: `n_k` of Eq. 2 and its length in one.
    normal: Vec2,
    /// What of the slice the normal faces lies between these, `low` the further from the zenith.
    low: Vec2,
    high: Vec2,
    /// Width `w_k` of Eq. 2 for a slice of one radian on the screen, over pi.
    weight: f32,
}

impl Slice {
    /// The slice of `receiver` whose trace on the screen has the unit direction `along`.
    #[inline]
    pub(crate) fn new(receiver: &Receiver, along: Vec2) -> Self {
        let Receiver { position, normal, distance } = *receiver;
        let across = position.truncate().dot(along);
        let up = (distance * distance - across * across).max(f32::MIN_POSITIVE).sqrt();
        let zenith = Vec2::new(-across, up) / distance;
        let side = Vec2::new(zenith.y, -zenith.x);
        let normal_across = normal.truncate().dot(along);
        let normal = Vec2::new(normal_across, -(normal.dot(position) - across * normal_across) / up);
        let normal = Vec2::new(normal.dot(zenith), normal.dot(side));
        // The ends of what the normal faces, a right angle to either side of it, no further than zenith and nadir.
        let (low, high) = if normal.x >= 0.0 {
            (Vec2::new(-normal.y, normal.x), Vec2::X)
        } else {
            (Vec2::NEG_X, Vec2::new(normal.y, -normal.x))
        };
        // Equal angles on the screen are not equal around the zenith: the ratio at the middle of the slice. Summed over
        // all slices that is a trapezoid rule of a smooth periodic function, all but exact.
        let weight = position.z * distance / (up * up) * std::f32::consts::FRAC_1_PI;
        Self { distance, slant: up / position.z, zenith, side, normal, low, high, weight }
    }

    /// Share of the whole hemisphere, over pi, of a slice of one radian on the screen.
    pub(crate) fn weight(&self) -> f32 {
        self.weight
    }

    /// The horizon before anything was met: the surface itself.
    pub(crate) fn open(&self) -> Vec2 {
        self.low
    }

    /// What maps (place along the trace in metres, depth in metres) to vectors from the eye: its columns.
    #[inline]
    pub(crate) fn axes(&self) -> [Vec2; 2] {
        [Vec2::new(self.zenith.x, self.side.x), Vec2::new(self.zenith.y, self.side.y) * -self.slant]
    }

    /// Where the line from `before` to `top` is met by the ray halfway between `horizon` and `top`, all from the eye: at
    /// the receiver when the line begins there.
    #[inline]
    fn joined(&self, before: Vec2, top: Vec2, horizon: Vec2) -> Vec2 {
        let eye = Vec2::new(self.distance, 0.0);
        let (start, end) = (before + eye, top + eye);
        let middle = horizon.normalize_or_zero() + end.normalize_or_zero();
        let (under, over) = (start.perp_dot(middle), end.perp_dot(middle));
        let part = if over > under { (-under / (over - under)).clamp(0.0, 1.0) } else { 1.0 };
        before + (top - before) * part
    }

    /// How far from the receiver on the trace, in slopes, a slab can begin to count: those that start beyond are further
    /// than `radius` from the receiver all along. Infinite when the radius reaches behind the eye's own plane.
    pub(crate) fn reach(&self, radius: f32) -> f32 {
        let sin = radius / self.distance;
        if sin >= 1.0 {
            return f32::INFINITY;
        }
        let cos = (1.0 - sin * sin).sqrt();
        let at = -self.zenith;
        let turned = Vec2::new(at.x * cos - at.y * sin, -at.y * cos - at.x * sin);
        let slope = self.slant * (at.x / -at.y);
        if turned.y > 0.0 { self.slant * (turned.x / turned.y) - slope } else { f32::INFINITY }
    }
}

/// Where the slab of a point stands, which stands for all that is between the point and what is known before it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SlabPlacement {
    /// At the point (section 4).
    Top,
    /// Midway between this line of sight, given as a vector from the eye, and the point.
    Midway(Vec2),
    /// The field is a straight line from this point, given from the eye, to the slab's: the slab is where the middle of
    /// what is seen of it is.
    Joined(Vec2),
}

/// How slabs are weighed, the same for all slices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimator<'a> {
    pub(crate) table: &'a ObscuranceTable,
    /// Slabs end this many metres behind their tops (section 11); `None` is never.
    pub(crate) thickness: Option<f32>,
}

impl Estimator<'_> {
    /// Adds a slab whose top is at `top`, as seen from the eye, to what is hidden of `slice`, and lifts `horizon` to it.
    /// Returns the slab's term of Eq. 3.
    ///
    /// `share` is how much of the slice's width the slab fills, in `(0, 1]`; the horizon rises by that share of the way.
    #[inline]
    pub(crate) fn add(
        &self,
        slice: &Slice,
        horizon: &mut Vec2,
        top: Vec2,
        stand: SlabPlacement,
        share: f32,
    ) -> f32 {
        let ray = Vec2::new(top.x + slice.distance, top.y);
        // Culled: below the horizon, or on the wrong side.
        if ray.perp_dot(*horizon) <= 0.0 || ray.y <= 0.0 {
            return 0.0;
        }
        let back = top / top.length();
        let slab = match stand {
            SlabPlacement::Top => back,
            SlabPlacement::Midway(sight) => (back + sight.normalize()).normalize(),
            SlabPlacement::Joined(before) => slice.joined(before, top, *horizon).normalize_or(back),
        };
        let distance = slice.distance * slab.y;
        let mut hidden = 0.0;
        if distance < self.table.radius() {
            let high = if ray.perp_dot(slice.high) > 0.0 { slice.high } else { ray };
            let mut low = *horizon;
            if let Some(thickness) = self.thickness {
                let bottom = ray + back * thickness;
                if bottom.perp_dot(low) > 0.0 {
                    low = bottom;
                }
            }
            if high.perp_dot(low) > 0.0 {
                hidden = share * self.table.hidden(distance.max(0.0), slab, slice.normal, low, high);
            }
        }
        *horizon = if share < 1.0 { horizon.normalize().lerp(ray.normalize(), share) } else { ray };
        hidden
    }
}
