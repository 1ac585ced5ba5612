//! The BVH of a scene at a given time.

use std::sync::Arc;

use glam::Vec3;
use psao_codec::memory;
use rayon::prelude::*;

use super::build::{build_rest, placement};
use super::dynamic_instance::{DynamicInstance, InstanceChange};
use super::static_batch::StaticBatch;
use crate::bvh::{Blas, BlasHit, BlasInstance, BodyId, Bounds, Placement, Tlas};
use crate::scene::{InstanceId, Motion, PosedMesh, Scene, ScenePose};
use crate::shortcuts::Shortcuts;

/// A hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in metres along the unit direction.
    pub t: f32,
    /// The hit instance.
    pub instance: InstanceId,
    /// Index of the triangle in the instance's mesh.
    pub triangle: u32,
    /// Weight of the triangle's second corner.
    pub u: f32,
    /// Weight of the triangle's third corner.
    pub v: f32,
}

/// The surface at a hit, in world space or rest space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceAt {
    /// Position in metres.
    pub position: Vec3,
    /// Unit normal of the triangle's front, or zero for a triangle without area.
    pub facing: Vec3,
    /// Unit shading normal of the front, bent by the normal map if there is one.
    pub normal: Vec3,
}

/// A scene at a given time, ready for rays. All static instances share one body in world space, the static batch.
/// Every other instance has its own body, placed by a rigid transform. So a rigid motion rebuilds only the small tree
/// over the bodies.
///
/// Only an edit ([`ScenePose::apply`]) moves or hides a static instance. The instance is then detached from the
/// static batch and permanently has its own body. An instance that a client moved is likely to move again, and each
/// change of body costs the AO of all points near it.
#[derive(Clone, Debug)]
pub struct SceneBvh {
    scene: Arc<Scene>,
    /// Whether each instance is in a static batch.
    shared: Vec<bool>,
    /// The instances that were static at the build, without the detached ones: one batch, or one per instance without
    /// [`Shortcuts::STATIC_BATCH`].
    static_batches: Vec<StaticBatch>,
    /// Trees of the meshes at rest that rigid dynamic instances use.
    rests: Vec<Option<Arc<Blas>>>,
    /// Dynamic instances in ascending order of instance.
    dynamic_instances: Vec<DynamicInstance>,
    bodies: Tlas,
    owners: Vec<Owner>,
    /// Body of each instance; `None` for one that is hidden or has no triangles.
    instance_bodies: Vec<Option<BodyId>>,
    placements: Vec<Placement>,
    changes: Vec<InstanceChange>,
    shortcuts: Shortcuts,
}

/// Source of a body's triangles.
#[derive(Clone, Copy, Debug)]
enum Owner {
    /// The static batch with this index.
    Batch(u32),
    /// The instance with this index.
    Instance(u32),
}

impl SceneBvh {
    /// Builds the BVH of the scene at a pose.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, pose: &ScenePose) -> Self {
        Self::with_shortcuts(scene, pose, Shortcuts::ALL)
    }

    /// Does the same as [`SceneBvh::new`] with a subset of the shortcuts. The hits of rays do not depend on it.
    #[must_use]
    pub fn with_shortcuts(scene: &Arc<Scene>, pose: &ScenePose, shortcuts: Shortcuts) -> Self {
        let count = scene.instances().len();
        let placements: Vec<Placement> = pose.instances().iter().map(|at| placement(at.frame())).collect();
        let shared: Vec<bool> = (0..count)
            .map(|index| {
                let instance = &scene.instances()[index];
                let fixed = instance.constant_frame.filter(|_| instance.motion() == Motion::Static);
                fixed.is_some_and(|fixed| is_at(pose, index, &placement(&fixed)))
            })
            .collect();
        let static_instances: Vec<usize> = (0..count).filter(|&index| shared[index]).collect();
        let batch_size =
            if shortcuts.contains(Shortcuts::STATIC_BATCH) { static_instances.len().max(1) } else { 1 };
        let static_batches = static_instances
            .par_chunks(batch_size)
            .map(|instances| StaticBatch::build(scene, pose, instances, &placements, shortcuts))
            .collect();
        let rigid = |&index: &usize| !shared[index] && scene.instances()[index].motion() != Motion::Deforming;
        let mut rests = vec![None; scene.rests().len()];
        let mut used: Vec<usize> =
            (0..count).filter(rigid).map(|index| scene.instances()[index].rest().index()).collect();
        used.sort_unstable();
        used.dedup();
        let built: Vec<Arc<Blas>> = used.par_iter().map(|&rest| build_rest(scene, rest, shortcuts)).collect();
        for (rest, blas) in used.into_iter().zip(built) {
            rests[rest] = Some(blas);
        }
        let dynamic_instances: Vec<usize> = (0..count).filter(|&index| !shared[index]).collect();
        let dynamic = |&index: &usize| {
            let rest = rests[scene.instances()[index].rest().index()].as_ref();
            DynamicInstance::posed(scene, pose, index, rest, shortcuts)
        };
        let dynamic_instances = dynamic_instances.par_iter().map(dynamic).collect();
        let mut world = Self {
            scene: Arc::clone(scene),
            shared,
            static_batches,
            rests,
            dynamic_instances,
            bodies: Tlas::default(),
            owners: Vec::new(),
            instance_bodies: vec![None; count],
            placements,
            changes: vec![InstanceChange::Unchanged; count],
            shortcuts,
        };
        world.rebuild_tlas();
        world
    }

    /// Moves the scene to another pose.
    pub fn update(&mut self, pose: &ScenePose) {
        let detached = self.detach(pose);
        let refits_static = !detached.is_empty() || !self.shortcuts.contains(Shortcuts::RIGID);
        let refits =
            refits_static || self.dynamic_instances.iter().any(|dynamic| dynamic.geometry().is_some());
        if refits {
            // Release shared trees, because a refit would copy them.
            self.bodies = Tlas::default();
        }
        if refits_static {
            let refit =
                |batch: &mut StaticBatch| batch.refit(&self.scene, pose, &self.placements, &self.shared);
            self.static_batches.par_iter_mut().for_each(refit);
        }
        let (scene, shortcuts) = (&self.scene, self.shortcuts);
        let update =
            |dynamic: &mut DynamicInstance| (dynamic.instance, dynamic.update(scene, pose, shortcuts));
        let changes: Vec<(usize, InstanceChange)> =
            self.dynamic_instances.par_iter_mut().map(update).collect();
        for (instance, change) in changes {
            self.changes[instance] = match change {
                InstanceChange::Moved(swept) if detached.binary_search(&instance).is_ok() => {
                    InstanceChange::Detached(swept)
                }
                change => change,
            };
        }
        for dynamic in &self.dynamic_instances {
            self.placements[dynamic.instance] = dynamic.placement;
        }
        if refits || self.changes.iter().any(|change| change.swept().is_some()) {
            self.rebuild_tlas();
        }
    }

    /// Gives own bodies to the static instances that a pose moves or hides. Places them at their old positions, so
    /// that the first move counts as a change. Returns these instances, ascending; their batch still contains their
    /// triangles.
    fn detach(&mut self, pose: &ScenePose) -> Vec<usize> {
        let detached = |&index: &usize| self.shared[index] && !is_at(pose, index, &self.placements[index]);
        let detached: Vec<usize> = (0..self.shared.len()).filter(detached).collect();
        for &index in &detached {
            self.shared[index] = false;
            let rest = self.scene.instances()[index].rest().index();
            let blas = self.rests[rest].get_or_insert_with(|| build_rest(&self.scene, rest, self.shortcuts));
            self.dynamic_instances.push(DynamicInstance::rigid(
                index,
                Arc::clone(blas),
                self.placements[index],
            ));
        }
        self.dynamic_instances.sort_unstable_by_key(|dynamic| dynamic.instance);
        detached
    }

    fn rebuild_tlas(&mut self) {
        self.instance_bodies.fill(None);
        let mut list = Vec::with_capacity(self.dynamic_instances.len() + self.static_batches.len());
        self.owners.clear();
        for (number, batch) in
            self.static_batches.iter().enumerate().filter(|(_, batch)| !batch.blas.bounds().is_empty())
        {
            for index in batch.instances().filter(|&index| self.shared[index]) {
                self.instance_bodies[index] = Some(BodyId::new(list.len() as u32));
            }
            list.push(BlasInstance::new(Arc::clone(&batch.blas), Placement::IDENTITY));
            self.owners.push(Owner::Batch(number as u32));
        }
        for dynamic in
            self.dynamic_instances.iter().filter(|dynamic| dynamic.visible && !dynamic.bounds.is_empty())
        {
            self.instance_bodies[dynamic.instance] = Some(BodyId::new(list.len() as u32));
            list.push(BlasInstance::new(Arc::clone(&dynamic.blas), dynamic.placement));
            self.owners.push(Owner::Instance(dynamic.instance as u32));
        }
        self.bodies = Tlas::new(list);
    }

    /// Returns the bytes of memory held: trees, posed geometry, and placements. Shared parts count once. The scene
    /// does not count.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        let Self {
            scene,
            shared,
            static_batches,
            rests,
            dynamic_instances,
            bodies,
            owners,
            instance_bodies,
            placements,
            changes,
            ..
        } = self;
        let batches: usize = static_batches.iter().map(StaticBatch::heap_bytes).sum();
        let at_rest: usize = rests.iter().flatten().map(|blas| blas.heap_bytes()).sum();
        let rest =
            |dynamic: &DynamicInstance| rests[scene.instances()[dynamic.instance].rest().index()].as_ref();
        let moving: usize = dynamic_instances.iter().map(|dynamic| dynamic.heap_bytes(rest(dynamic))).sum();
        let swept = changes.iter().filter_map(InstanceChange::swept).map(|swept| memory::list(&swept.parts));
        let structures = memory::list(static_batches)
            + memory::list(rests)
            + memory::list(dynamic_instances)
            + memory::list(owners);
        let instances = memory::list(shared) + memory::list(instance_bodies) + memory::list(placements);
        let trees = batches + at_rest + moving + bodies.heap_bytes();
        trees + structures + instances + memory::list(changes) + swept.sum::<usize>()
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Returns the bounds of everything.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bodies.bounds()
    }

    /// Returns the placement of an instance, or the identity for an unknown instance.
    #[must_use]
    pub fn placement(&self, instance: InstanceId) -> Placement {
        self.placements.get(instance.index()).copied().unwrap_or(Placement::IDENTITY)
    }

    /// Returns an instance's mesh in its local space, in its current pose or the last visible one. Returns `None` for
    /// an unknown instance.
    #[must_use]
    pub fn posed(&self, instance: InstanceId) -> Option<PosedMesh<'_>> {
        let rest = self.scene.rest(self.scene.instances().get(instance.index())?);
        let dynamic =
            self.dynamic_instances.binary_search_by_key(&instance.index(), |dynamic| dynamic.instance).ok();
        let deformed = dynamic.and_then(|dynamic| self.dynamic_instances[dynamic].geometry());
        Some(PosedMesh::posed(&self.scene, rest, deformed.unwrap_or(rest.geometry())))
    }

    /// Returns the nearest hit within `tmax` metres along a unit direction. Both sides of a triangle can be hit. Rays
    /// pass through masked-out texels.
    #[must_use]
    pub fn closest(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<Hit> {
        let found = self.bodies.nearest(origin, direction, tmax, false, |body, hit| self.opaque(body, hit));
        found.map(|(body, hit)| self.hit(body, &hit))
    }

    /// Returns whether anything is within `tmax` metres along a unit direction.
    #[must_use]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        self.bodies.nearest(origin, direction, tmax, true, |body, hit| self.opaque(body, hit)).is_some()
    }

    /// Returns whether a drawn surface is between a place and an eye, which is `distance` metres away in a unit direction. The
    /// backs of one-sided faces are not drawn (glTF 2.0, section 3.9.2, double sided).
    pub(crate) fn hides(&self, place: Vec3, direction: Vec3, distance: f32) -> bool {
        let drawn = |body: BodyId, hit: &BlasHit| {
            self.opaque(body, hit) && self.is_drawn(body, hit.triangle, direction)
        };
        self.bodies.nearest(place, direction, distance, true, drawn).is_some()
    }

    /// Returns whether an eye in a direction of the world sees the side of a triangle that faces it.
    fn is_drawn(&self, body: BodyId, triangle: u32, direction: Vec3) -> bool {
        let (instance, triangle) = self.source(body, triangle);
        let Some(posed) = self.posed(InstanceId(instance)) else { return true };
        let facing = self.placement(InstanceId(instance)).direction(posed.facing(triangle));
        posed.material.double_sided() || facing.dot(direction) > 0.0
    }

    /// Returns the surface at a hit of this scene, or `None` for an unknown instance or triangle.
    #[must_use]
    pub fn surface(&self, hit: &Hit) -> Option<SurfaceAt> {
        let local = surface(&self.posed(hit.instance)?, hit)?;
        let at = self.placement(hit.instance);
        Some(SurfaceAt {
            position: at.point(local.position),
            facing: at.direction(local.facing),
            normal: at.direction(local.normal),
        })
    }

    /// Returns the place of a hit on the mesh at rest: on the same triangle with the same weights, whatever the
    /// instance's pose. It is in the space of [`RestMesh::geometry`](crate::scene::RestMesh::geometry), not in world
    /// space. Returns `None` for an unknown instance or triangle.
    #[must_use]
    pub fn rest_surface(&self, hit: &Hit) -> Option<SurfaceAt> {
        let instance = self.scene.instances().get(hit.instance.index())?;
        surface(&PosedMesh::at_rest(&self.scene, self.scene.rest(instance)), hit)
    }

    pub(crate) fn bodies(&self) -> &Tlas {
        &self.bodies
    }

    /// Returns the current body of an instance, if it has one.
    pub(crate) fn body(&self, instance: usize) -> Option<BodyId> {
        self.instance_bodies[instance]
    }

    /// Returns whether the space of an instance's body is the world.
    pub(crate) fn is_still(&self, instance: usize) -> bool {
        self.shared[instance]
    }

    /// Returns whether an instance is visible and can be hit.
    pub(crate) fn is_present(&self, instance: usize) -> bool {
        self.instance_bodies[instance].is_some()
    }

    /// Returns the change of each instance in the last [`SceneBvh::update`].
    pub(crate) fn changes(&self) -> &[InstanceChange] {
        &self.changes
    }

    /// Returns whether the mask keeps the surface at a hit.
    pub(crate) fn opaque(&self, body: BodyId, hit: &BlasHit) -> bool {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.intersection.barycentric();
        let posed = self.posed(InstanceId(instance));
        posed.is_none_or(|posed| !posed.masked() || posed.opaque(triangle, [u, v]))
    }

    /// Returns whether a direction, in the space of a body, meets the back of a one-sided triangle of it.
    pub(crate) fn is_back(&self, body: BodyId, triangle: u32, direction: Vec3) -> bool {
        let (instance, triangle) = self.source(body, triangle);
        let Some(posed) = self.posed(InstanceId(instance)) else { return false };
        if posed.material.double_sided() {
            return false;
        }
        let facing = posed.facing(triangle);
        let in_body = match self.owners[body.index()] {
            Owner::Batch(_) => self.placement(InstanceId(instance)).direction(facing),
            Owner::Instance(_) => facing,
        };
        in_body.dot(direction) > 0.0
    }

    fn hit(&self, body: BodyId, hit: &BlasHit) -> Hit {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.intersection.barycentric();
        Hit { t: hit.intersection.t, instance: InstanceId(instance), triangle, u, v }
    }

    /// Returns the instance and its triangle for a triangle of a body.
    fn source(&self, body: BodyId, triangle: u32) -> (u32, u32) {
        match self.owners[body.index()] {
            Owner::Batch(number) => self.static_batches[number as usize].source(triangle),
            Owner::Instance(instance) => (instance, triangle),
        }
    }
}

/// Returns the surface of a mesh at the triangle and weights of a hit, in the mesh's space.
fn surface(posed: &PosedMesh<'_>, hit: &Hit) -> Option<SurfaceAt> {
    if hit.triangle as usize >= posed.triangles.len() {
        return None;
    }
    let [a, b, c] = posed.corners(hit.triangle);
    Some(SurfaceAt {
        position: a + (b - a) * hit.u + (c - a) * hit.v,
        facing: posed.facing(hit.triangle),
        normal: posed.shading_normal(hit.triangle, [hit.u, hit.v]),
    })
}

/// Returns whether an instance is visible at exactly this placement in a pose.
fn is_at(pose: &ScenePose, index: usize, at: &Placement) -> bool {
    let now = &pose.instances()[index];
    now.visible() && placement(now.frame()) == *at
}
