//! A slice of the hemisphere over a receiver: the estimator of Timonen, section 4.
//!
//! A slice is a half plane through the receiver and the eye. Vectors in it are (along the zenith, to the side); the
//! zenith points to the eye. Angles are compared by cross products and never computed.

use glam::{Vec2, Vec3};

use super::table::ObscuranceTable;

/// A pixel for which obscurance is gathered.
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

    /// Returns the depth in metres.
    pub(crate) fn depth(&self) -> f32 {
        self.position.z
    }

    /// Returns the slope of the line of sight: the place on a screen one metre away.
    pub(crate) fn slope(&self) -> Vec2 {
        self.position.truncate() / self.position.z
    }
}

/// A half plane through a receiver and the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slice {
    /// Distance of receiver and eye.
    distance: f32,
    /// Scale from depths to the slanted plane (`zScale` of Algorithm 2).
    slant: f32,
    /// Unit vectors of the plane in its axes (along the screen, towards the eye's own plane).
    zenith: Vec2,
    side: Vec2,
    /// The normal projected onto the plane, not normalised: `n_k` of Eq. 2 times its length.
    normal: Vec2,
    /// Ends of the part of the slice that the normal faces; `low` is further from the zenith.
    low: Vec2,
    high: Vec2,
    /// `w_k` of Eq. 2 over pi, for a slice of one radian on the screen.
    weight: f32,
}

impl Slice {
    /// Makes the slice of `receiver` whose trace on the screen has the unit direction `along`.
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
        // The ends are a right angle to either side of the normal, but not beyond zenith and nadir.
        let (low, high) = if normal.x >= 0.0 {
            (Vec2::new(-normal.y, normal.x), Vec2::X)
        } else {
            (Vec2::NEG_X, Vec2::new(normal.y, -normal.x))
        };
        // Equal angles on the screen are not equal around the zenith. The weight is their ratio at the middle of the
        // slice. Summed over all slices that is a trapezoid rule of a smooth periodic function, which is almost exact.
        let weight = position.z * distance / (up * up) * std::f32::consts::FRAC_1_PI;
        Self { distance, slant: up / position.z, zenith, side, normal, low, high, weight }
    }

    /// Returns the share of the whole hemisphere, over pi, of a slice of one radian on the screen.
    pub(crate) fn weight(&self) -> f32 {
        self.weight
    }

    /// Returns the horizon without any occluder: the surface itself.
    pub(crate) fn open(&self) -> Vec2 {
        self.low
    }

    /// Returns the columns of the map from (place along the trace, depth), in metres, to vectors from the eye.
    #[inline]
    pub(crate) fn axes(&self) -> [Vec2; 2] {
        [Vec2::new(self.zenith.x, self.side.x), Vec2::new(self.zenith.y, self.side.y) * -self.slant]
    }

    /// Returns the place where the ray halfway between `horizon` and `top` meets the line from `before` to `top`, all
    /// from the eye. It is at the receiver when the line begins there.
    #[inline]
    fn joined(&self, before: Vec2, top: Vec2, horizon: Vec2) -> Vec2 {
        let eye = Vec2::new(self.distance, 0.0);
        let (start, end) = (before + eye, top + eye);
        let middle = horizon.normalize_or_zero() + end.normalize_or_zero();
        let (under, over) = (start.perp_dot(middle), end.perp_dot(middle));
        let part = if over > under { (-under / (over - under)).clamp(0.0, 1.0) } else { 1.0 };
        before + (top - before) * part
    }

    /// Returns the largest distance from the receiver on the trace, in slopes, at which a slab may start to count.
    ///
    /// A slab that starts beyond is everywhere further than `radius` from the receiver. The result is infinite when the
    /// radius reaches behind the eye's plane.
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

/// The place of a point's slab, which represents everything between the point and the known points before it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SlabPlacement {
    /// At the point (section 4).
    Top,
    /// Midway between this line of sight, given as a vector from the eye, and the point.
    Midway(Vec2),
    /// At the middle of the visible part of the line from this point, given as a vector from the eye, to the slab's
    /// point. The field is straight there.
    Joined(Vec2),
}

/// Weights of slabs, the same for all slices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimator<'a> {
    pub(crate) table: &'a ObscuranceTable,
    /// Length of slabs in metres behind their tops (section 11); `None` is infinite.
    pub(crate) thickness: Option<f32>,
}

impl Estimator<'_> {
    /// Returns the term of Eq. 3 of a slab with its top at `top`, as seen from the eye, and raises `horizon` to it.
    ///
    /// The slab fills `share` of the slice's width, in `(0, 1]`. The horizon rises by that share of the way.
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
