//! Simple shapes made of triangles, for stress cases and tests.

use glam::Vec3;

/// Returns the two triangles of a square on y = 0 that faces up and reaches `half` metres from the origin.
pub(crate) fn floor(half: f32) -> Vec<[Vec3; 3]> {
    let at = |x: f32, z: f32| Vec3::new(x * half, 0.0, z * half);
    vec![[at(-1.0, -1.0), at(1.0, 1.0), at(1.0, -1.0)], [at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)]]
}

/// Returns the twelve triangles of a cube around `centre`. Its faces are `half` metres away and face outwards.
pub(crate) fn cube(centre: Vec3, half: f32) -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::with_capacity(12);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (mut out, mut u, mut v) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
            out[axis] = side * half;
            u[(axis + 1) % 3] = side * half;
            v[(axis + 2) % 3] = half;
            let [a, b, c, d] = [-u - v, u - v, u + v, v - u].map(|corner| centre + out + corner);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

/// Returns the same triangles, facing the other way.
pub(crate) fn inside_out(triangles: &[[Vec3; 3]]) -> Vec<[Vec3; 3]> {
    triangles.iter().map(|&[a, b, c]| [a, c, b]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area([a, b, c]: [Vec3; 3]) -> Vec3 {
        (b - a).cross(c - a) * 0.5
    }

    #[test]
    fn a_cube_is_closed_and_faces_outwards() {
        let centre = Vec3::new(1.0, 2.0, 3.0);
        let faces = cube(centre, 0.5);
        assert_eq!(faces.iter().map(|&t| area(t).length()).sum::<f32>(), 6.0);
        assert_eq!(faces.iter().map(|&t| area(t)).sum::<Vec3>(), Vec3::ZERO);
        assert!(faces.iter().all(|&t| area(t).dot(t[0] + t[1] + t[2] - 3.0 * centre) > 0.0));
        assert!(inside_out(&faces).iter().all(|&t| area(t).dot(t[0] + t[1] + t[2] - 3.0 * centre) < 0.0));
    }

    #[test]
    fn a_floor_faces_up() {
        assert_eq!(floor(1.5).iter().map(|&t| area(t)).sum::<Vec3>(), Vec3::Y * 9.0);
    }
}
