//! A reference tracer for tests and benchmarks of the packets. It traces single rays through the box tree of `obvhs`,
//! one triangle after the other, in double precision. It shares neither tree layout nor arithmetic with the packets.

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray as PlainRay, RayHit};
use obvhs::{BvhBuildParams, triangle::Triangle};

use super::ray_workload::Ray;

/// All triangles of a scene in one tree.
pub struct ReferenceTracer {
    bvh: Bvh2,
    /// Triangles in the order of the leaves.
    triangles: Vec<[DVec3; 3]>,
}

impl ReferenceTracer {
    /// Builds the tree. Ignores triangles with a corner that is not finite.
    #[must_use]
    pub fn new(triangles: &[[Vec3; 3]]) -> Self {
        let finite = triangles.iter().filter(|triangle| triangle.iter().all(|corner| corner.is_finite()));
        let plain: Vec<Triangle> =
            finite.map(|&[a, b, c]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() }).collect();
        let bvh = build_bvh2_from_tris(&plain, BvhBuildParams::medium_build(), &mut Duration::default());
        let corners =
            |&Triangle { v0, v1, v2 }: &Triangle| [v0, v1, v2].map(|corner| Vec3::from(corner).as_dvec3());
        let triangles = bvh.primitive_indices.iter().map(|&index| corners(&plain[index as usize])).collect();
        Self { bvh, triangles }
    }

    /// Returns the distance to the nearest triangle within the ray's length, or infinity.
    #[must_use]
    pub fn closest(&self, ray: &Ray) -> f32 {
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(plain(ray), &mut hit, |_, index| distance(&self.triangles[index], ray));
        if hit.t < ray.length { hit.t } else { f32::INFINITY }
    }

    /// Returns whether any triangle is within the ray's length.
    #[must_use]
    pub fn occluded(&self, ray: &Ray) -> bool {
        !self.bvh.ray_traverse_miss(plain(ray), |_, index| distance(&self.triangles[index], ray))
    }
}

fn plain(ray: &Ray) -> PlainRay {
    PlainRay::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), 0.0, ray.length)
}

/// Returns the distance to a triangle by the signed volumes of ray and edges, or infinity.
fn distance(corners: &[DVec3; 3], ray: &Ray) -> f32 {
    let (origin, along) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let [a, b, c] = [corners[0] - origin, corners[1] - origin, corners[2] - origin];
    let volumes = [along.dot(b.cross(c)), along.dot(c.cross(a)), along.dot(a.cross(b))];
    let inside = volumes.iter().all(|&volume| volume >= 0.0) || volumes.iter().all(|&volume| volume <= 0.0);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let t = normal.dot(a) / along.dot(normal);
    if inside && t > 0.0 { t as f32 } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::ao::{AoSettings, Instructions, Occlusion, RayWorkload, Scratch, Tracer};
    use crate::points::{PointSettings, generate};
    use crate::scene::Scene;

    #[test]
    fn packets_agree_with_the_reference_tracer_with_all_instructions() {
        for name in ["colonnade", "robot-lab"] {
            let scene = Arc::new(Scene::load(name).unwrap());
            let settings = PointSettings { per_m2: 1.0, minimum: 16, seed: 3 };
            let points = generate(&scene, &settings, &|_, _| {}).unwrap();
            for kind in [Occlusion::Obscurance, Occlusion::Binary] {
                let ao = AoSettings { rays: 48, kind, ..AoSettings::default() };
                let tracer = Tracer::new(ao).unwrap();
                let workload = RayWorkload::new(&scene, &points, tracer.clone(), 150, 7);
                assert_eq!(workload.points(), 150);
                let found = workload.distances(&mut Scratch::default());
                let reference = ReferenceTracer::new(&workload.triangles());
                let (mut hits, mut differ) = (0, 0);
                for (ray, &fast) in workload.rays().iter().zip(&found) {
                    let slow = reference.closest(ray);
                    assert_eq!(reference.occluded(ray), slow.is_finite());
                    let same = match kind {
                        Occlusion::Obscurance => fast == slow || (fast - slow).abs() < 1e-4,
                        Occlusion::Binary => fast.is_finite() == slow.is_finite(),
                    };
                    hits += u32::from(fast.is_finite());
                    differ += u32::from(!same);
                }
                assert!(hits > 500 && differ <= 3, "{name}: {differ} of {hits} hits differ");
                let workload = Instructions::all().into_iter().fold(workload, |workload, instructions| {
                    let workload = workload.with_tracer(tracer.clone().with_instructions(instructions));
                    assert_eq!(workload.distances(&mut Scratch::default()), found);
                    workload
                });
                let hidden: f64 =
                    found.iter().map(|&t| if t.is_finite() { 1.0 - f64::from(t / 0.6) } else { 0.0 }).sum();
                if kind == Occlusion::Obscurance {
                    let mean = 1.0 - hidden / found.len() as f64;
                    assert!((workload.trace(&mut Scratch::default()) - mean).abs() < 1e-5);
                }
            }
        }
    }
}
