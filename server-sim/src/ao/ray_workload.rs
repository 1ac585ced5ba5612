//! The rays of a sample of a scene's points, for benchmarks of tracers.

use std::sync::Arc;

use glam::Vec3;

use super::tracer::{RayFrame, Scratch, SelfHitCache, Tracer};
use crate::points::{PointInSet, RayKey, ScenePoints};
use crate::random::{mix, unit};
use crate::scene::{InstanceId, Scene};
use crate::world::SceneBvh;

/// One ray in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin in metres.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Length in metres; farther triangles are not hit.
    pub length: f32,
}

/// A sample of a scene's points at its first pose, and all of their rays. Masks are ignored: masked triangles are
/// solid, as they are to a tracer without textures.
pub struct RayWorkload {
    world: SceneBvh,
    tracer: Tracer,
    /// Ray key and frame of each point.
    points: Vec<(RayKey, RayFrame)>,
}

impl RayWorkload {
    /// Samples `count` points (at least 1, at most all), evenly spaced in the order in which a server traces them.
    /// `seed` determines the first of them.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, points: &ScenePoints, tracer: Tracer, count: u32, seed: u64) -> Self {
        let world = SceneBvh::new(scene, &scene.pose(0.0));
        let step = f64::from(points.total()) / f64::from(count.clamp(1, points.total().max(1)));
        let mut next = f64::from(unit(mix(seed))) * step;
        let mut taken = Vec::new();
        for (index, instance) in scene.instances().iter().enumerate() {
            let id = InstanceId(index as u32);
            let (Some(posed), true) = (world.posed(id), world.is_present(index)) else { continue };
            let set = &points.sets()[instance.rest().index()];
            let first = points.id(index, PointInSet(0)).0;
            let at = world.placement(id);
            while next < f64::from(first) + set.points().len() as f64 {
                let point = PointInSet((next as u32).saturating_sub(first));
                next += step;
                let Some(placed) = set.points().get(point.index()).map(|point| point.place_on(&posed)) else {
                    continue;
                };
                let (mut position, mut normal, mut edge) = (placed.position, placed.normal, placed.edge);
                if world.is_still(index) {
                    (position, normal, edge) = (at.point(position), at.direction(normal), at.direction(edge));
                }
                let ray_frame = RayFrame { body: world.body(index), position, normal, edge };
                taken.push((points.ray_key(index, set, point), ray_frame));
            }
        }
        Self { world, tracer, points: taken }
    }

    /// Returns the same points with another tracer. Its settings must have the same [`super::AoSettings::rays`],
    /// radius and seed.
    #[must_use]
    pub fn with_tracer(self, tracer: Tracer) -> Self {
        Self { tracer, ..self }
    }

    /// Returns the number of sampled points.
    #[must_use]
    pub fn points(&self) -> usize {
        self.points.len()
    }

    /// Traces all rays as a server does, on the calling thread. Returns the mean AO.
    #[must_use]
    pub fn trace(&self, scratch: &mut Scratch) -> f64 {
        let bodies = self.world.bodies();
        let ao = self.points.iter().map(|&(key, ray_frame)| {
            f64::from(self.tracer.trace(bodies, key, &ray_frame, &|_, _| true, SelfHitCache::Off, scratch).ao)
        });
        ao.sum::<f64>() / self.points.len().max(1) as f64
    }

    /// Returns the result of [`RayWorkload::trace`] per ray: the distance of the nearest hit in metres, or infinity
    /// without a hit. With binary occlusion the distance of a hit is 0.
    #[must_use]
    pub fn distances(&self, scratch: &mut Scratch) -> Vec<f32> {
        let mut all = Vec::with_capacity(self.points.len() * self.tracer.settings().rays as usize);
        for (key, ray_frame) in &self.points {
            self.tracer.distances(self.world.bodies(), *key, ray_frame, scratch, &mut all);
        }
        all
    }

    /// Returns all rays in the order of [`RayWorkload::distances`].
    #[must_use]
    pub fn rays(&self) -> Vec<Ray> {
        let rays = self.points.iter().flat_map(|(key, ray_frame)| {
            let (origin, directions) = self.tracer.rays(self.world.bodies(), *key, ray_frame);
            let length = self.tracer.settings().radius;
            directions.into_iter().map(move |direction| Ray { origin, direction, length })
        });
        rays.collect()
    }

    /// Returns all visible triangles in world space.
    #[must_use]
    pub fn triangles(&self) -> Vec<[Vec3; 3]> {
        let mut all = Vec::new();
        let present = |index: &u32| self.world.is_present(*index as usize);
        for index in (0..self.world.scene().instances().len() as u32).filter(present) {
            let Some(posed) = self.world.posed(InstanceId(index)) else { continue };
            let at = self.world.placement(InstanceId(index));
            let triangles = 0..posed.triangles.len() as u32;
            all.extend(triangles.map(|triangle| posed.corners(triangle).map(|corner| at.point(corner))));
        }
        all
    }
}
