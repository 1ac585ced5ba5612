//! The camera's path: smooth between keys, constant beyond its ends.

use glam::{DVec3, Vec3};

/// One key of a camera path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraKey {
    /// Time of the key, seconds.
    pub time_s: f64,
    /// Position of the eye, metres.
    pub eye: Vec3,
    /// Point looked at, metres.
    pub target: Vec3,
    /// Direction that is up in the picture.
    pub up: Vec3,
}

/// A camera path: at least one key, in ascending time.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraPath {
    fov_y_deg: f32,
    keys: Vec<CameraKey>,
}

impl CameraPath {
    pub(crate) fn new(fov_y_deg: f32, keys: Vec<CameraKey>) -> Self {
        Self { fov_y_deg, keys }
    }

    /// Returns a camera that sees the whole sphere of `radius` metres around `centre`, obliquely from above.
    pub(crate) fn around(centre: Vec3, radius: f32) -> Self {
        let eye = centre + Vec3::new(0.55, 0.4, 0.75) * (radius * 2.4).max(0.1);
        Self::new(50.0, vec![CameraKey { time_s: 0.0, eye, target: centre, up: Vec3::Y }])
    }

    /// Returns the vertical opening angle, degrees.
    #[must_use]
    pub fn fov_y_deg(&self) -> f32 {
        self.fov_y_deg
    }

    /// Returns the keys, in ascending time.
    #[must_use]
    pub fn keys(&self) -> &[CameraKey] {
        &self.keys
    }

    /// Returns eye, target and up direction at a given time. They follow a cubic Hermite curve through the keys with
    /// Catmull-Rom tangents: the slope between the neighbours, one-sided at the ends.
    #[must_use]
    pub fn at(&self, time_s: f64) -> CameraKey {
        let next = self.keys.partition_point(|key| key.time_s <= time_s);
        let last = self.keys.len().saturating_sub(1);
        match (next.checked_sub(1), self.keys.get(next)) {
            (Some(i), Some(_)) => self.between(i, time_s),
            (None, _) => CameraKey { time_s, ..self.keys[0] },
            (Some(_), None) => CameraKey { time_s, ..self.keys[last] },
        }
    }

    fn between(&self, i: usize, time_s: f64) -> CameraKey {
        let (a, b) = (&self.keys[i], &self.keys[i + 1]);
        let span = b.time_s - a.time_s;
        let s = (time_s - a.time_s) / span;
        let curve = |get: fn(&CameraKey) -> Vec3| {
            let [p, q] = [a, b].map(|key| get(key).as_dvec3());
            let [m, n] = [i, i + 1].map(|k| self.slope(k, get) * span);
            let (s2, s3) = (s * s, s * s * s);
            let blend = 3.0 * s2 - 2.0 * s3;
            (p + (q - p) * blend + m * (s3 - 2.0 * s2 + s) + n * (s3 - s2)).as_vec3()
        };
        CameraKey { time_s, eye: curve(|k| k.eye), target: curve(|k| k.target), up: curve(|k| k.up) }
    }

    /// Returns the change per second at a key.
    fn slope(&self, i: usize, get: fn(&CameraKey) -> Vec3) -> DVec3 {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(self.keys.len() - 1));
        let span = self.keys[b].time_s - self.keys[a].time_s;
        (get(&self.keys[b]).as_dvec3() - get(&self.keys[a]).as_dvec3()) / span
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time_s: f64, x: f32) -> CameraKey {
        CameraKey { time_s, eye: Vec3::new(x, 1.0, 0.0), target: Vec3::ZERO, up: Vec3::Y }
    }

    #[test]
    fn goes_through_its_keys_and_stops_at_the_ends() {
        let path = CameraPath::new(60.0, vec![key(1.0, 0.0), key(2.0, 4.0), key(4.0, 1.0)]);
        for (time, x) in [(-5.0, 0.0), (1.0, 0.0), (2.0, 4.0), (4.0, 1.0), (99.0, 1.0)] {
            assert_eq!(path.at(time).eye, Vec3::new(x, 1.0, 0.0), "at {time} s");
        }
    }

    #[test]
    fn is_linear_between_evenly_spaced_collinear_keys() {
        let path = CameraPath::new(60.0, vec![key(0.0, 0.0), key(1.0, 1.0), key(2.0, 2.0), key(3.0, 3.0)]);
        for i in 0..=30 {
            let time = f64::from(i) / 10.0;
            assert!((f64::from(path.at(time).eye.x) - time).abs() < 1e-6);
        }
    }

    #[test]
    fn speed_does_not_jump_at_a_key() {
        let path = CameraPath::new(60.0, vec![key(0.0, 0.0), key(1.0, 3.0), key(2.5, 1.0), key(3.0, 2.0)]);
        for time in [1.0, 2.5] {
            let slope = |a: f64, b: f64| f64::from(path.at(b).eye.x - path.at(a).eye.x) / (b - a);
            assert!((slope(time - 1e-3, time) - slope(time, time + 1e-3)).abs() < 0.05);
        }
    }

    #[test]
    fn a_single_key_stands_still() {
        let path = CameraPath::new(60.0, vec![key(3.0, 2.0)]);
        assert_eq!(path.at(0.0).eye, path.at(10.0).eye);
    }
}
