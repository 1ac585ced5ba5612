//! Spheres and planes with exact intersections, for tests.

use glam::Vec3;

use super::{Surface, Surfaces};

/// A shape. Its index in [`Analytic`] is its instance.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    Sphere { centre: Vec3, radius: f32 },
    Plane { point: Vec3, normal: Vec3 },
}

pub(crate) struct Analytic(pub(crate) Vec<Shape>);

impl Shape {
    fn hit(self, origin: Vec3, dir: Vec3) -> Option<(f32, Vec3)> {
        match self {
            Self::Plane { point, normal } => {
                let t = (point - origin).dot(normal) / dir.dot(normal);
                (t > 0.0 && t.is_finite()).then_some((t, normal))
            }
            Self::Sphere { centre, radius } => {
                let to = centre - origin;
                let along = to.dot(dir);
                let inside = along * along - to.length_squared() + radius * radius;
                if inside < 0.0 {
                    return None;
                }
                let root = inside.sqrt();
                let t = if along > root { along - root } else { along + root };
                (t > 0.0).then(|| (t, (origin + dir * t - centre) / radius))
            }
        }
    }
}

impl Surfaces for Analytic {
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface> {
        let hits = self.0.iter().zip(0u32..).filter_map(|(shape, instance)| {
            let (t, normal) = shape.hit(origin, dir)?;
            let normal = if normal.dot(dir) > 0.0 { -normal } else { normal };
            (t <= tmax).then_some(Surface { t, position: origin + dir * t, normal, instance, rest: None })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }
}
