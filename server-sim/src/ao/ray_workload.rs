//! The rays of a sample of a scene's points, to measure tracers by.

use std::sync::Arc;

use glam::Vec3;

use super::tracer::{RayFrame, Scratch, SelfHitCache, Tracer};
use crate::points::{PointInSet, RayKey, ScenePoints};
use crate::random::{mix, unit};
use crate::scene::{InstanceId, Scene};
use crate::world::SceneBvh;

/// One ray, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Metres.
    pub origin: Vec3,
    /// Unit.
    pub direction: Vec3,
    /// Metres; what is farther is not hit.
    pub length: f32,
}

/// Some points of a scene at its first pose, and all rays that AO takes from them. Masks count for nothing here: their
/// triangles are solid, as they are to a tracer that has no textures.
pub struct RayWorkload {
    world: SceneBvh,
    tracer: Tracer,
    /// Ray key and frame of each point.
    points: Vec<(RayKey, RayFrame)>,
}

impl RayWorkload {
    /// Takes `count` points (at most; at least 1), evenly spread over all in the order in which a server traces them;
    /// `seed` says which.
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

    /// Returns the same points and rays, traced by other settings of the same [`super::AoSettings::rays`], radius and
    /// seed, or by other instructions.
    #[must_use]
    pub fn with_tracer(self, tracer: Tracer) -> Self {
        Self { tracer, ..self }
    }

    /// How many points were taken.
    #[must_use]
    pub fn points(&self) -> usize {
        self.points.len()
    }

    /// Traces all rays as a server does, on the calling thread; gives the mean AO.
    #[must_use]
    pub fn trace(&self, scratch: &mut Scratch) -> f64 {
        let bodies = self.world.bodies();
        let ao = self.points.iter().map(|&(key, ray_frame)| {
            f64::from(self.tracer.trace(bodies, key, &ray_frame, &|_, _| true, SelfHitCache::Off, scratch).ao)
        });
        ao.sum::<f64>() / self.points.len().max(1) as f64
    }

    /// What [`RayWorkload::trace`] found, ray by ray: the distance in metres of the nearest hit, with binary occlusion 0 for
    /// any, and infinity for none.
    #[must_use]
    pub fn distances(&self, scratch: &mut Scratch) -> Vec<f32> {
        let mut all = Vec::with_capacity(self.points.len() * self.tracer.settings().rays as usize);
        for (key, ray_frame) in &self.points {
            self.tracer.distances(self.world.bodies(), *key, ray_frame, scratch, &mut all);
        }
        all
    }

    /// All rays, in the order of [`RayWorkload::distances`].
    #[must_use]
    pub fn rays(&self) -> Vec<Ray> {
        let rays = self.points.iter().flat_map(|(key, ray_frame)| {
            let (origin, directions) = self.tracer.rays(self.world.bodies(), *key, ray_frame);
            let length = self.tracer.settings().radius;
            directions.into_iter().map(move |direction| Ray { origin, direction, length })
        });
        rays.collect()
    }

    /// All triangles in sight, in the world.
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
