//! Animation curves in double precision: step, linear and cubic-spline interpolation as glTF 2.0 defines them
//! (section 3.11 and appendix C).
//!
//! A curve whose keys are all equal gives the same bits at every time.

use glam::DQuat;

/// Interpolation between the keys of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interpolation {
    /// Holds a key's value until the next key.
    Step,
    /// Interpolates along straight lines; rotations along great arcs.
    Linear,
    /// Interpolates by cubic Hermite splines with the keys' own tangents.
    Cubic,
}

/// Property of a node that a curve drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Property {
    /// Three numbers, metres.
    Translation,
    /// A unit quaternion, x y z w.
    Rotation,
    /// Three factors.
    Scale,
    /// One weight per morph target.
    Weights,
    /// One number; 0 hides the node and everything below it.
    Visibility,
}

impl Property {
    /// Returns whether it is part of a node's transform.
    pub(crate) fn moves(self) -> bool {
        matches!(self, Self::Translation | Self::Rotation | Self::Scale)
    }
}

/// Key values over time. Whoever builds a curve guarantees at least one key, finite times in ascending order and
/// `times.len() * width` finite values. A cubic curve has three times as many values: in-tangent, value and
/// out-tangent of each key.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    pub(crate) interpolation: Interpolation,
    pub(crate) rotation: bool,
    pub(crate) width: usize,
    pub(crate) times: Vec<f32>,
    pub(crate) values: Vec<f32>,
}

impl Curve {
    /// Returns the time of the last key, seconds.
    pub(crate) fn end_s(&self) -> f64 {
        self.times.last().map_or(0.0, |t| f64::from(*t))
    }

    /// Returns whether any two times can give different results.
    pub(crate) fn varies(&self) -> bool {
        let stride = self.width * self.parts();
        let (first, rest) = self.values.split_at(stride.min(self.values.len()));
        let moving = |key: &[f32]| {
            let same = key == first || self.rotation && key.iter().zip(first).all(|(a, b)| *a == -*b);
            !same || self.interpolation == Interpolation::Cubic && self.tangents_move(key)
        };
        rest.chunks(stride.max(1)).any(moving) || (!rest.is_empty() && moving(first))
    }

    fn tangents_move(&self, key: &[f32]) -> bool {
        let (w, zero) = (self.width, |v: &f32| *v == 0.0);
        !(key[..w].iter().all(zero) && key[2 * w..].iter().all(zero))
    }

    fn parts(&self) -> usize {
        if self.interpolation == Interpolation::Cubic { 3 } else { 1 }
    }

    /// Returns one component of a key. `part` selects the in-tangent (0), value (1) or out-tangent (2) of a cubic
    /// curve.
    fn value(&self, key: usize, part: usize, component: usize) -> f64 {
        let (parts, part) = if self.parts() == 3 { (3, part) } else { (1, 0) };
        f64::from(self.values[(key * parts + part) * self.width + component])
    }

    /// Writes the value at a given time into `out[..width]`. Before the first and after the last key it is constant.
    /// Rotations are unit quaternions.
    pub(crate) fn sample(&self, time_s: f64, out: &mut [f64]) {
        let next = self.times.partition_point(|t| f64::from(*t) <= time_s);
        let last = self.times.len() - 1;
        let key = next.saturating_sub(1);
        let held = next == 0 || key == last || self.interpolation == Interpolation::Step;
        // Rotations along arcs start from unit keys, so that a constant stretch and a stretch between equal keys
        // agree bit for bit.
        let arcs = self.rotation && self.interpolation != Interpolation::Cubic;
        let span_s = |key: usize| f64::from(self.times[key + 1]) - f64::from(self.times[key]);
        let along = |key: usize| (time_s - f64::from(self.times[key])) / span_s(key);
        if arcs {
            let start = self.quaternion(key);
            let turn = if held { start } else { slerp(start, self.quaternion(key + 1), along(key)) };
            out[..4].copy_from_slice(&turn.to_array());
        } else if held {
            (0..self.width).for_each(|c| out[c] = self.value(key, 1, c));
        } else if self.interpolation == Interpolation::Cubic {
            (0..self.width).for_each(|c| out[c] = self.spline(key, c, along(key), span_s(key)));
        } else {
            for (c, slot) in out.iter_mut().enumerate().take(self.width) {
                let (a, b) = (self.value(key, 1, c), self.value(key + 1, 1, c));
                *slot = a + (b - a) * along(key);
            }
        }
        if self.rotation {
            let unit = unit_quaternion(DQuat::from_array([out[0], out[1], out[2], out[3]]));
            out[..4].copy_from_slice(&unit.to_array());
        }
    }

    /// Returns a key's rotation as a unit quaternion.
    fn quaternion(&self, key: usize) -> DQuat {
        unit_quaternion(DQuat::from_array([0, 1, 2, 3].map(|c| self.value(key, 1, c))))
    }

    /// Evaluates a cubic Hermite spline (glTF 2.0, appendix C.4). Tangents are per second.
    fn spline(&self, key: usize, component: usize, s: f64, span: f64) -> f64 {
        let (p, q) = (self.value(key, 1, component), self.value(key + 1, 1, component));
        let (m, n) = (span * self.value(key, 2, component), span * self.value(key + 1, 0, component));
        let (s2, s3) = (s * s, s * s * s);
        p + (q - p) * (3.0 * s2 - 2.0 * s3) + m * (s3 - 2.0 * s2 + s) + n * (s3 - s2)
    }
}

/// Returns a quaternion scaled to unit length, or the identity for a quaternion without length.
pub(crate) fn unit_quaternion(q: DQuat) -> DQuat {
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if norm > 1e-12 && norm.is_finite() {
        DQuat::from_xyzw(q.x / norm, q.y / norm, q.z / norm, q.w / norm)
    } else {
        DQuat::IDENTITY
    }
}

/// Interpolates spherically along the shorter arc (glTF 2.0, appendix C.3). Quaternions so close that the arc's sine
/// is unreliable are interpolated linearly; the caller scales the result to unit length.
fn slerp(a: DQuat, b: DQuat, s: f64) -> DQuat {
    let dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
    let b = if dot < 0.0 { -b } else { b };
    let dot = dot.abs();
    let mix = |f: fn(DQuat) -> f64, g: f64, h: f64| f(a) * g + f(b) * h;
    if dot > 0.999_999 {
        let line = |f: fn(DQuat) -> f64| f(a) + (f(b) - f(a)) * s;
        return DQuat::from_xyzw(line(|q| q.x), line(|q| q.y), line(|q| q.z), line(|q| q.w));
    }
    let angle = libm::acos(dot);
    let sine = libm::sin(angle);
    let (g, h) = (libm::sin((1.0 - s) * angle) / sine, libm::sin(s * angle) / sine);
    DQuat::from_xyzw(mix(|q| q.x, g, h), mix(|q| q.y, g, h), mix(|q| q.z, g, h), mix(|q| q.w, g, h))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(
        interpolation: Interpolation,
        rotation: bool,
        width: usize,
        times: &[f32],
        values: &[f32],
    ) -> Curve {
        Curve { interpolation, rotation, width, times: times.to_vec(), values: values.to_vec() }
    }

    fn at<const N: usize>(curve: &Curve, time_s: f64) -> [f64; N] {
        let mut out = [0.0; N];
        curve.sample(time_s, &mut out);
        out
    }

    #[test]
    fn step_holds_and_linear_goes_straight() {
        let (times, values) = ([1.0, 2.0, 4.0], [10.0, 20.0, 0.0]);
        let step = curve(Interpolation::Step, false, 1, &times, &values);
        let line = curve(Interpolation::Linear, false, 1, &times, &values);
        for (time, held, straight) in [
            (0.0, 10.0, 10.0),
            (1.0, 10.0, 10.0),
            (1.75, 10.0, 17.5),
            (2.0, 20.0, 20.0),
            (3.0, 20.0, 10.0),
            (9.0, 0.0, 0.0),
        ] {
            assert_eq!((at::<1>(&step, time), at::<1>(&line, time)), ([held], [straight]), "at {time} s");
        }
    }

    #[test]
    fn cubic_spline_follows_its_polynomial() {
        // Keys of f(t) = t^3 - 2t with its own derivative as tangents: the spline is the polynomial itself.
        let f = |t: f64| t * t * t - 2.0 * t;
        let slope = |t: f64| 3.0 * t * t - 2.0;
        let times = [0.0, 0.5, 2.0];
        let values: Vec<f32> =
            times.iter().flat_map(|&t| [slope(t), f(t), slope(t)]).map(|v| v as f32).collect();
        let spline = curve(Interpolation::Cubic, false, 1, &times.map(|t| t as f32), &values);
        for i in 0..=40 {
            let t = f64::from(i) / 20.0;
            assert!((at::<1>(&spline, t)[0] - f(t)).abs() < 1e-6, "at {t} s");
        }
    }

    #[test]
    fn slerp_turns_evenly_along_the_shorter_arc() {
        let about_z = |degrees: f64| {
            let half = degrees.to_radians() / 2.0;
            [0.0, 0.0, libm::sin(half) as f32, libm::cos(half) as f32]
        };
        let target = about_z(120.0);
        for end in [target, target.map(|v| -v)] {
            let values = [about_z(0.0), end].concat();
            let turning = curve(Interpolation::Linear, true, 4, &[0.0, 1.0], &values);
            for i in 0..=12 {
                let q = at::<4>(&turning, f64::from(i) / 12.0);
                let angle = 2.0 * libm::atan2(q[2] * q[3].signum(), q[3].abs());
                assert!((angle.to_degrees() - 10.0 * f64::from(i)).abs() < 1e-4, "step {i}: {angle}");
            }
        }
    }

    #[test]
    fn nearly_equal_rotations_fall_back_to_a_line_and_stay_unit() {
        let values = [0.0, 0.0, 0.0, 1.0, 1e-4, 0.0, 0.0, 1.0];
        let turning = curve(Interpolation::Linear, true, 4, &[0.0, 1.0], &values);
        let q = at::<4>(&turning, 0.5);
        assert!((q[0] - 5e-5).abs() < 1e-9 && (q.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
        let none = curve(Interpolation::Linear, true, 4, &[0.0], &[0.0; 4]);
        assert_eq!(at::<4>(&none, 0.0), [0.0, 0.0, 0.0, 1.0], "a quaternion without length turns nothing");
    }

    #[test]
    fn equal_keys_do_not_vary_by_a_single_bit() {
        let q = [0.1_f32, 0.7, -0.2, 0.3];
        let cubic: Vec<f32> = [[0.0; 4], q, [0.0; 4]].concat().repeat(3);
        let flipped = [q, q.map(|v| -v), q].concat();
        for (interpolation, values) in [
            (Interpolation::Linear, q.repeat(3)),
            (Interpolation::Linear, flipped),
            (Interpolation::Cubic, cubic),
        ] {
            let still = curve(interpolation, true, 4, &[0.0, 0.7, 1.3], &values);
            assert!(!still.varies());
            let turn = |t| glam::DMat3::from_quat(DQuat::from_array(at::<4>(&still, t)));
            for i in 0..50 {
                assert_eq!(turn(f64::from(i) * 0.031), turn(0.0));
            }
        }
        assert!(curve(Interpolation::Step, false, 1, &[0.0, 1.0], &[1.0, 2.0]).varies());
        assert!(curve(Interpolation::Cubic, false, 1, &[0.0, 1.0], &[0.0, 1.0, 2.0, 0.0, 1.0, 0.0]).varies());
        assert!(
            !curve(Interpolation::Cubic, false, 1, &[0.0], &[5.0, 1.0, 2.0]).varies(),
            "one key stands still"
        );
    }
}
