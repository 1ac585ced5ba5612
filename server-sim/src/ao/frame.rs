//! The frame of a point's rays. It moves with the surface, so that rays keep their place on it.

use glam::{Mat3, Vec3};

/// Returns the columns tangent, bitangent, normal. `normal` is unit. `edge` is any direction that moves with the
/// surface, such as the first edge of the deformed triangle. For an edge along the normal a fixed tangent is chosen.
#[must_use]
pub fn tangent_frame(normal: Vec3, edge: Vec3) -> Mat3 {
    let flat = edge - normal * normal.dot(edge);
    let tangent = match flat.try_normalize() {
        Some(tangent) if flat.length_squared() > 1e-12 * edge.length_squared() => tangent,
        _ => {
            // Take the axis farthest from the normal.
            let size = normal.abs();
            let axis = if size.x <= size.y && size.x <= size.z {
                Vec3::X
            } else if size.y <= size.z {
                Vec3::Y
            } else {
                Vec3::Z
            };
            (axis - normal * normal.dot(axis)).normalize_or(Vec3::X)
        }
    };
    Mat3::from_cols(tangent, normal.cross(tangent), normal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_a_rotation_whatever_the_edge(
            normal in prop::array::uniform3(-1f32..1.0), edge in prop::array::uniform3(-1f32..1.0),
            along in prop_oneof![Just(0f32), Just(1.0)],
        ) {
            let normal = Vec3::from(normal).normalize_or(Vec3::Y);
            let edge = Vec3::from(edge).lerp(normal * 0.3, along);
            let frame = tangent_frame(normal, edge);
            prop_assert!((frame.determinant() - 1.0).abs() < 1e-4);
            let off = frame.transpose() * frame - Mat3::IDENTITY;
            prop_assert!(off.to_cols_array().iter().all(|e| e.abs() < 1e-4));
            prop_assert_eq!(frame.z_axis, normal);
        }
    }

    #[test]
    fn turns_with_the_surface() {
        let (normal, edge) = (Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.4, 0.3, 0.5));
        let turn = Mat3::from_rotation_z(1.1) * Mat3::from_rotation_x(-0.4);
        let moved = tangent_frame(turn * normal, turn * edge);
        assert!(moved.abs_diff_eq(turn * tangent_frame(normal, edge), 1e-6));
        assert_eq!(tangent_frame(normal, Vec3::ZERO).z_axis, normal);
    }
}
