//! A scene at one moment, ready for rays.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::blas::{Blas, BlasHit};
use super::bodies::{Bodies, Body, Placement};
use super::bounds::Bounds;
use super::tree::Effort;
use crate::ao::Seat;
use crate::points::PosedMesh;
use crate::scene::{Geometry, InstanceId, Motion, Scene, ScenePose};

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

/// What happened to an instance from one moment to the next.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Stir {
    /// Nothing: every bit is the same.
    Still,
    /// It moved as a rigid body, or came or went.
    Moved(Swept),
    /// Its local geometry changed too.
    Deformed(Swept),
}

/// Where an instance was before and is now.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Swept {
    /// All of it.
    pub(crate) bounds: Bounds,
    /// The same in parts: every triangle, before and after, is in one of them.
    pub(crate) parts: Vec<Bounds>,
}

impl Stir {
    /// Where the world may have changed.
    pub(crate) fn swept(&self) -> Option<&Swept> {
        match self {
            Self::Still => None,
            Self::Moved(swept) | Self::Deformed(swept) => Some(swept),
        }
    }
}

/// An instance that moves, and what it is made of now.
#[derive(Clone, Debug)]
struct Mover {
    instance: usize,
    placement: Placement,
    visible: bool,
    bounds: Bounds,
    /// World bounds of the nodes `cut` of the tree.
    parts: Vec<Bounds>,
    cut: Vec<u32>,
    blas: Arc<Blas>,
    /// Geometry of a deforming instance and the work its tree took when it was built.
    shape: Option<Shape>,
}

#[derive(Clone, Debug)]
struct Shape {
    geometry: Geometry,
    spare: Geometry,
    built_cost: f32,
}

/// Parts that a moving instance is cut into, to tell what it comes near.
const PARTS: usize = 32;

/// A refitted tree that costs this many times as much as when it was built is built anew.
const WORN: f32 = 1.6;

/// A scene at one moment: all static instances together in one body in world space, every other one a body of its own
/// that is placed rigidly. Moving rigidly rebuilds nothing but the small tree over the bodies.
#[derive(Clone, Debug)]
pub struct World {
    scene: Arc<Scene>,
    /// The static instances' triangles; the numbers of each instance's first triangle there.
    still: Arc<Blas>,
    still_starts: Vec<(u32, u32)>,
    movers: Vec<Mover>,
    bodies: Bodies,
    /// Instance of each body; the static one has none.
    body_instances: Vec<Option<u32>>,
    /// Body of each instance, [`Seat::WORLD`] while it has none.
    instance_bodies: Vec<u32>,
    placements: Vec<Placement>,
    stirs: Vec<Stir>,
}

impl World {
    /// Builds the structures of the scene at a pose of it.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, pose: &ScenePose) -> Self {
        let (still, still_starts) = build_still(scene, pose);
        let rigid: Vec<bool> = (0..scene.rests().len())
            .map(|rest| {
                scene.instances().iter().any(|i| i.motion() == Motion::Rigid && i.rest().index() == rest)
            })
            .collect();
        let shared: Vec<Option<Arc<Blas>>> = scene
            .rests()
            .par_iter()
            .zip(&rigid)
            .map(|(rest, &used)| used.then(|| Arc::new(build(&PosedMesh::at_rest(scene, rest)))))
            .collect();
        let moving = |&index: &usize| scene.instances()[index].motion() != Motion::Static;
        let movers: Vec<usize> = (0..scene.instances().len()).filter(moving).collect();
        let movers = movers.par_iter().map(|&index| Mover::new(scene, pose, index, &shared)).collect();
        let count = scene.instances().len();
        let mut world = Self {
            scene: Arc::clone(scene),
            still: Arc::new(still),
            still_starts,
            movers,
            bodies: Bodies::default(),
            body_instances: Vec::new(),
            instance_bodies: vec![Seat::WORLD; count],
            placements: pose.instances().iter().map(|at| placement(at.frame())).collect(),
            stirs: vec![Stir::Still; count],
        };
        world.assemble();
        world
    }

    /// Moves on to another pose of the same scene.
    pub fn update(&mut self, pose: &ScenePose) {
        let scene = &self.scene;
        let stirs: Vec<(usize, Stir)> =
            self.movers.par_iter_mut().map(|mover| (mover.instance, mover.update(scene, pose))).collect();
        for (instance, stir) in stirs {
            self.stirs[instance] = stir;
        }
        for mover in &self.movers {
            self.placements[mover.instance] = mover.placement;
        }
        if self.stirs.iter().any(|stir| stir.swept().is_some()) {
            self.assemble();
        }
    }

    fn assemble(&mut self) {
        self.instance_bodies.fill(Seat::WORLD);
        let mut list = Vec::with_capacity(self.movers.len() + 1);
        self.body_instances.clear();
        if !self.still.bounds().is_empty() {
            list.push(Body::new(Arc::clone(&self.still), Placement::IDENTITY));
            self.body_instances.push(None);
            for &(_, instance) in &self.still_starts {
                self.instance_bodies[instance as usize] = 0;
            }
        }
        for mover in self.movers.iter().filter(|mover| mover.visible && !mover.bounds.is_empty()) {
            self.instance_bodies[mover.instance] = list.len() as u32;
            list.push(Body::new(Arc::clone(&mover.blas), mover.placement));
            self.body_instances.push(Some(mover.instance as u32));
        }
        self.bodies = Bodies::new(list);
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

    /// An instance's mesh in its local space as it is now; `None` for one that is not in the scene.
    #[must_use]
    pub fn posed(&self, instance: InstanceId) -> Option<PosedMesh<'_>> {
        let rest = self.scene.rest(self.scene.instances().get(instance.index())?);
        let deformed = self.movers.binary_search_by_key(&instance.index(), |mover| mover.instance).ok();
        let shape = deformed.and_then(|mover| self.movers[mover].shape.as_ref());
        Some(PosedMesh::posed(&self.scene, rest, shape.map_or(rest.geometry(), |shape| &shape.geometry)))
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

    /// Body of an instance now, [`Seat::WORLD`] for none.
    pub(crate) fn body(&self, instance: usize) -> u32 {
        self.instance_bodies[instance]
    }

    /// Whether the space of an instance's body is the world, not its own.
    pub(crate) fn is_still(&self, instance: usize) -> bool {
        self.scene.instances()[instance].motion() == Motion::Static
    }

    /// Whether an instance can be seen and hit now.
    pub(crate) fn is_present(&self, instance: usize) -> bool {
        self.instance_bodies[instance] != Seat::WORLD
    }

    /// What happened to each instance in the last [`World::update`].
    pub(crate) fn stirs(&self) -> &[Stir] {
        &self.stirs
    }

    /// Whether the texel at a hit is there.
    pub(crate) fn opaque(&self, body: u32, hit: &BlasHit) -> bool {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.meeting.barycentric();
        let posed = self.posed(InstanceId(instance));
        posed.is_none_or(|posed| !posed.masked() || posed.opaque(triangle, [u, v]))
    }

    fn hit(&self, body: u32, hit: &BlasHit) -> Hit {
        let (instance, triangle) = self.source(body, hit.triangle);
        let [_, u, v] = hit.meeting.barycentric();
        Hit { t: hit.meeting.t, instance: InstanceId(instance), triangle, u, v }
    }

    /// Instance and triangle of a triangle of a body.
    fn source(&self, body: u32, triangle: u32) -> (u32, u32) {
        match self.body_instances[body as usize] {
            Some(instance) => (instance, triangle),
            None => {
                let at = self.still_starts.partition_point(|&(first, _)| first <= triangle) - 1;
                let (first, instance) = self.still_starts[at];
                (instance, triangle - first)
            }
        }
    }
}

impl Mover {
    fn new(scene: &Arc<Scene>, pose: &ScenePose, index: usize, shared: &[Option<Arc<Blas>>]) -> Self {
        let instance = &scene.instances()[index];
        let at = &pose.instances()[index];
        let (blas, shape) = match &shared[instance.rest().index()] {
            Some(blas) if instance.motion() == Motion::Rigid => (Arc::clone(blas), None),
            _ => {
                let mut geometry = Geometry::default();
                scene.local_geometry(InstanceId(index as u32), pose, &mut geometry);
                let blas = build(&PosedMesh::posed(scene, scene.rest(instance), &geometry));
                let built_cost = blas.cost();
                (Arc::new(blas), Some(Shape { geometry, spare: Geometry::default(), built_cost }))
            }
        };
        let placement = placement(at.frame());
        let bounds = Body::new(Arc::clone(&blas), placement).bounds();
        let cut = blas.tree().cut(PARTS);
        let parts = parts(&blas, &cut, &placement);
        Self { instance: index, placement, visible: at.visible(), bounds, parts, cut, blas, shape }
    }

    fn update(&mut self, scene: &Arc<Scene>, pose: &ScenePose) -> Stir {
        let at = &pose.instances()[self.instance];
        let now = placement(at.frame());
        let moved = now != self.placement || at.visible() != self.visible;
        (self.placement, self.visible) = (now, at.visible());
        let (deformed, rebuilt) = self.deform(scene, pose);
        if !moved && !deformed {
            return Stir::Still;
        }
        let bounds = Body::new(Arc::clone(&self.blas), now).bounds();
        let parts = parts(&self.blas, &self.cut, &now);
        let before = std::mem::replace(&mut self.parts, parts.clone());
        let joined = if before.len() == parts.len() && !rebuilt {
            before.iter().zip(&parts).map(|(before, after)| before.union(*after)).collect()
        } else {
            [before, parts].concat()
        };
        let swept =
            Swept { bounds: std::mem::replace(&mut self.bounds, bounds).union(bounds), parts: joined };
        if deformed { Stir::Deformed(swept) } else { Stir::Moved(swept) }
    }

    /// Brings a deforming instance's geometry up to date; says whether any bit of it changed, and whether its tree is a
    /// new one.
    fn deform(&mut self, scene: &Arc<Scene>, pose: &ScenePose) -> (bool, bool) {
        let Some(shape) = &mut self.shape else { return (false, false) };
        scene.local_geometry(InstanceId(self.instance as u32), pose, &mut shape.spare);
        if shape.spare == shape.geometry {
            return (false, false);
        }
        std::mem::swap(&mut shape.spare, &mut shape.geometry);
        let posed = PosedMesh::posed(scene, scene.rest(&scene.instances()[self.instance]), &shape.geometry);
        let blas = Arc::make_mut(&mut self.blas);
        blas.refit(&corners(&posed));
        let worn = blas.cost() > WORN * shape.built_cost;
        if worn {
            *blas = build(&posed);
            shape.built_cost = blas.cost();
            self.cut = blas.tree().cut(PARTS);
        }
        (true, worn)
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

/// World bounds of some nodes of a body's tree.
fn parts(blas: &Blas, cut: &[u32], at: &Placement) -> Vec<Bounds> {
    let nodes = blas.tree().nodes();
    cut.iter().map(|&node| nodes[node as usize].bounds.transformed(at.rotation, at.translation)).collect()
}

fn placement(frame: &crate::scene::RigidFrame) -> Placement {
    Placement { rotation: frame.matrix(), translation: frame.translation }
}

fn corners(posed: &PosedMesh<'_>) -> Vec<[Vec3; 3]> {
    (0..posed.triangles.len() as u32).map(|triangle| posed.corners(triangle)).collect()
}

fn build(posed: &PosedMesh<'_>) -> Blas {
    let blas = Blas::build(&corners(posed), Effort::Best);
    if posed.masked() { blas.with_masks(|_| true) } else { blas }
}

/// All static instances in one body, with the number of each one's first triangle.
fn build_still(scene: &Arc<Scene>, pose: &ScenePose) -> (Blas, Vec<(u32, u32)>) {
    let (mut triangles, mut starts, mut masked) = (Vec::new(), Vec::new(), Vec::new());
    for (index, instance) in (0u32..).zip(scene.instances()) {
        if instance.motion() != Motion::Static {
            continue;
        }
        let posed = PosedMesh::at_rest(scene, scene.rest(instance));
        let at = placement(pose.instances()[index as usize].frame());
        starts.push((triangles.len() as u32, index));
        triangles.extend(corners(&posed).into_iter().map(|triangle| triangle.map(|corner| at.point(corner))));
        masked.resize(triangles.len(), posed.masked());
    }
    let blas = Blas::build(&triangles, Effort::Best).with_masks(|triangle| masked[triangle as usize]);
    (blas, starts)
}
