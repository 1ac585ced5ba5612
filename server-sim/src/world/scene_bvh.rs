//! A scene at one moment, ready for rays.

use std::sync::Arc;

use glam::Vec3;
use psao_codec::memory;
use rayon::prelude::*;

use super::build::{build_rest, placement};
use super::dynamic_instance::{Mover, Stir};
use super::static_batch::Still;
use crate::bvh::{Blas, BlasHit, Bodies, Body, BodyId, Bounds, Placement};
use crate::scene::{InstanceId, Motion, PosedMesh, Scene, ScenePose};
use crate::shortcuts::Shortcuts;

/// Where a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in metres along the unit direction.
    pub t: f32,
    /// Which instance.
    pub instance: InstanceId,
    /// Triangle of the instance's mesh.
    pub triangle: u32,
    /// Weight of the triangle's second corner.
    pub u: f32,
    /// Weight of the triangle's third corner.
    pub v: f32,
}

/// The surface at a hit: world space, or rest space where it says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceAt {
    /// Metres.
    pub position: Vec3,
    /// Unit normal of the triangle's front; zero for a triangle without area.
    pub facing: Vec3,
    /// Unit shading normal of the front, bent by the normal map if there is one.
    pub normal: Vec3,
}

/// A scene at one moment: all still instances together in one body in world space, every other one a body of its own
/// that is placed rigidly. Moving rigidly rebuilds nothing but the small tree over the bodies.
///
/// A static instance is still until a pose has it elsewhere or out of sight, which its animation never does, only an
/// edit ([`ScenePose::apply`]). Then it is taken out of the shared body and has one of its own for good: what was moved
/// by hand will be moved again, and every change of body costs the AO of all points near it.
#[derive(Clone, Debug)]
pub struct World {
    scene: Arc<Scene>,
    /// Whether each instance is in the body of the still ones.
    shared: Vec<bool>,
    /// The instances that were still when it was built, but for those that have left: one body of all of them.
    still: Vec<Still>,
    /// Meshes at rest of what does not deform, as far as movers need them.
    rests: Vec<Option<Arc<Blas>>>,
    /// By instance.
    movers: Vec<Mover>,
    bodies: Bodies,
    owners: Vec<Owner>,
    /// Body of each instance; none while it is out of sight or without triangles.
    instance_bodies: Vec<Option<BodyId>>,
    placements: Vec<Placement>,
    stirs: Vec<Stir>,
    shortcuts: Shortcuts,
}

/// Whose triangles a body holds.
#[derive(Clone, Copy, Debug)]
enum Owner {
    /// Those of a list of still instances, by number.
    Still(u32),
    /// Those of one instance.
    Instance(u32),
}

impl World {
    /// Builds the structures of the scene at a pose of it.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, pose: &ScenePose) -> Self {
        Self::with_shortcuts(scene, pose, Shortcuts::ALL)
    }

    /// As [`World::new`], leaving out no more than `shortcuts` say: what rays meet is the same.
    #[must_use]
    pub fn with_shortcuts(scene: &Arc<Scene>, pose: &ScenePose, shortcuts: Shortcuts) -> Self {
        let count = scene.instances().len();
        let placements: Vec<Placement> = pose.instances().iter().map(|at| placement(at.frame())).collect();
        let shared: Vec<bool> = (0..count)
            .map(|index| {
                let instance = &scene.instances()[index];
                let fixed = instance.fixed.filter(|_| instance.motion() == Motion::Static);
                fixed.is_some_and(|fixed| stands(pose, index, &placement(&fixed)))
            })
            .collect();
        let standing: Vec<usize> = (0..count).filter(|&index| shared[index]).collect();
        let together = if shortcuts.contains(Shortcuts::STILL) { standing.len().max(1) } else { 1 };
        let still = standing
            .par_chunks(together)
            .map(|instances| Still::build(scene, pose, instances, &placements, shortcuts))
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
        let movers: Vec<usize> = (0..count).filter(|&index| !shared[index]).collect();
        let mover = |&index: &usize| {
            let rest = rests[scene.instances()[index].rest().index()].as_ref();
            Mover::posed(scene, pose, index, rest, shortcuts)
        };
        let movers = movers.par_iter().map(mover).collect();
        let mut world = Self {
            scene: Arc::clone(scene),
            shared,
            still,
            rests,
            movers,
            bodies: Bodies::default(),
            owners: Vec::new(),
            instance_bodies: vec![None; count],
            placements,
            stirs: vec![Stir::Still; count],
            shortcuts,
        };
        world.assemble();
        world
    }

    /// Moves on to another pose of the same scene.
    pub fn update(&mut self, pose: &ScenePose) {
        let left = self.part(pose);
        let refits_still = !left.is_empty() || !self.shortcuts.contains(Shortcuts::RIGID);
        let refits = refits_still || self.movers.iter().any(|mover| mover.geometry().is_some());
        if refits {
            // A tree that the bodies share would be copied before it is refitted.
            self.bodies = Bodies::default();
        }
        if refits_still {
            let refit = |still: &mut Still| still.refit(&self.scene, pose, &self.placements, &self.shared);
            self.still.par_iter_mut().for_each(refit);
        }
        let (scene, shortcuts) = (&self.scene, self.shortcuts);
        let update = |mover: &mut Mover| (mover.instance, mover.update(scene, pose, shortcuts));
        let stirs: Vec<(usize, Stir)> = self.movers.par_iter_mut().map(update).collect();
        for (instance, stir) in stirs {
            self.stirs[instance] = match stir {
                Stir::Moved(swept) if left.binary_search(&instance).is_ok() => Stir::Left(swept),
                stir => stir,
            };
        }
        for mover in &self.movers {
            self.placements[mover.instance] = mover.placement;
        }
        if refits || self.stirs.iter().any(|stir| stir.swept().is_some()) {
            self.assemble();
        }
    }

    /// Gives bodies of their own to the still instances that a pose has elsewhere or out of sight: where they stood, so
    /// that their first move is seen as one. Gives those instances, ascending; the body that they shared still has them.
    fn part(&mut self, pose: &ScenePose) -> Vec<usize> {
        let gone = |&index: &usize| self.shared[index] && !stands(pose, index, &self.placements[index]);
        let gone: Vec<usize> = (0..self.shared.len()).filter(gone).collect();
        for &index in &gone {
            self.shared[index] = false;
            let rest = self.scene.instances()[index].rest().index();
            let blas = self.rests[rest].get_or_insert_with(|| build_rest(&self.scene, rest, self.shortcuts));
            self.movers.push(Mover::rigid(index, Arc::clone(blas), self.placements[index]));
        }
        self.movers.sort_unstable_by_key(|mover| mover.instance);
        gone
    }

    fn assemble(&mut self) {
        self.instance_bodies.fill(None);
        let mut list = Vec::with_capacity(self.movers.len() + self.still.len());
        self.owners.clear();
        for (number, still) in
            self.still.iter().enumerate().filter(|(_, still)| !still.blas.bounds().is_empty())
        {
            for index in still.instances().filter(|&index| self.shared[index]) {
                self.instance_bodies[index] = Some(BodyId::new(list.len() as u32));
            }
            list.push(Body::new(Arc::clone(&still.blas), Placement::IDENTITY));
            self.owners.push(Owner::Still(number as u32));
        }
        for mover in self.movers.iter().filter(|mover| mover.visible && !mover.bounds.is_empty()) {
            self.instance_bodies[mover.instance] = Some(BodyId::new(list.len() as u32));
            list.push(Body::new(Arc::clone(&mover.blas), mover.placement));
            self.owners.push(Owner::Instance(mover.instance as u32));
        }
        self.bodies = Bodies::new(list);
    }

    /// Bytes of memory held: trees, the posed geometry of what deforms, and where everything is. What instances share counts
    /// once; the scene does not.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let Self {
            scene,
            shared,
            still,
            rests,
            movers,
            bodies,
            owners,
            instance_bodies,
            placements,
            stirs,
            ..
        } = self;
        let stills: usize = still.iter().map(Still::held).sum();
        let at_rest: usize = rests.iter().flatten().map(|blas| blas.held()).sum();
        let rest = |mover: &Mover| rests[scene.instances()[mover.instance].rest().index()].as_ref();
        let moving: usize = movers.iter().map(|mover| mover.held(rest(mover))).sum();
        let swept = stirs.iter().filter_map(Stir::swept).map(|swept| memory::list(&swept.parts));
        let structures =
            memory::list(still) + memory::list(rests) + memory::list(movers) + memory::list(owners);
        let instances = memory::list(shared) + memory::list(instance_bodies) + memory::list(placements);
        let trees = stills + at_rest + moving + bodies.held();
        trees + structures + instances + memory::list(stirs) + swept.sum::<usize>()
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Bounds of everything.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bodies.bounds()
    }

    /// Where an instance is; of one that is not in the scene, the identity.
    #[must_use]
    pub fn placement(&self, instance: InstanceId) -> Placement {
        self.placements.get(instance.index()).copied().unwrap_or(Placement::IDENTITY)
    }

    /// An instance's mesh in its local space as it is now, or was when it was last in sight; `None` for one that is not
    /// in the scene.
    #[must_use]
    pub fn posed(&self, instance: InstanceId) -> Option<PosedMesh<'_>> {
        let rest = self.scene.rest(self.scene.instances().get(instance.index())?);
        let mover = self.movers.binary_search_by_key(&instance.index(), |mover| mover.instance).ok();
        let deformed = mover.and_then(|mover| self.movers[mover].geometry());
        Some(PosedMesh::posed(&self.scene, rest, deformed.unwrap_or(rest.geometry())))
    }

    /// The nearest hit nearer than `tmax` metres along a unit direction. Both sides of a triangle are hit; masked-out
    /// texels let rays through.
    #[must_use]
    pub fn closest(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<Hit> {
        let found = self.bodies.nearest(origin, direction, tmax, false, |body, hit| self.opaque(body, hit));
        found.map(|(body, hit)| self.hit(body, &hit))
    }

    /// Whether anything is nearer than `tmax` metres along a unit direction.
    #[must_use]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        self.bodies.nearest(origin, direction, tmax, true, |body, hit| self.opaque(body, hit)).is_some()
    }

    /// The surface at a hit of this world; `None` for a hit of another one.
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

    /// Where a hit of this world is on the mesh at rest, whatever pose the instance is in now: on the same triangle,
    /// with the same weights of its corners. In the space of [`RestMesh::geometry`](crate::scene::RestMesh::geometry),
    /// not the world's. `None` for a hit of another world.
    #[must_use]
    pub fn rest_surface(&self, hit: &Hit) -> Option<SurfaceAt> {
        let instance = self.scene.instances().get(hit.instance.index())?;
        surface(&PosedMesh::at_rest(&self.scene, self.scene.rest(instance)), hit)
    }

    pub(crate) fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// Body of an instance now, if it has one.
    pub(crate) fn body(&self, instance: usize) -> Option<BodyId> {
        self.instance_bodies[instance]
    }

    /// Whether the space of an instance's body is the world, not its own.
    pub(crate) fn is_still(&self, instance: usize) -> bool {
        self.shared[instance]
    }

    /// Whether an instance can be seen and hit now.
    pub(crate) fn is_present(&self, instance: usize) -> bool {
        self.instance_bodies[instance].is_some()
    }

    /// What happened to each instance in the last [`World::update`].
    pub(crate) fn stirs(&self) -> &[Stir] {
        &self.stirs
    }

    /// Whether the texel at a hit is there.
    pub(crate) fn opaque(&self, body: BodyId, hit: &BlasHit) -> bool {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.meeting.barycentric();
        let posed = self.posed(InstanceId(instance));
        posed.is_none_or(|posed| !posed.masked() || posed.opaque(triangle, [u, v]))
    }

    fn hit(&self, body: BodyId, hit: &BlasHit) -> Hit {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.meeting.barycentric();
        Hit { t: hit.meeting.t, instance: InstanceId(instance), triangle, u, v }
    }

    /// Instance and triangle of a triangle of a body.
    fn source(&self, body: BodyId, triangle: u32) -> (u32, u32) {
        match self.owners[body.index()] {
            Owner::Still(number) => self.still[number as usize].source(triangle),
            Owner::Instance(instance) => (instance, triangle),
        }
    }
}

/// The surface of a mesh where a hit's triangle and weights say, in the mesh's space.
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

/// Whether a pose has an instance in sight and at this very place.
fn stands(pose: &ScenePose, index: usize, at: &Placement) -> bool {
    let now = &pose.instances()[index];
    now.visible() && placement(now.frame()) == *at
}
