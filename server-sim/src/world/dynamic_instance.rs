//! An instance with its own body, and its changes from one moment to the next.

use std::sync::Arc;

use psao_codec::memory;

use super::build::{build, corners, placement};
use crate::bvh::{Blas, BlasInstance, Bounds, Placement};
use crate::scene::{Geometry, InstanceId, Motion, PosedMesh, Scene, ScenePose};
use crate::shortcuts::Shortcuts;

/// Change of an instance from one moment to the next.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum InstanceChange {
    /// The instance is bit-identical.
    Unchanged,
    /// The instance moved as a rigid body, appeared or disappeared.
    Moved(SweptBounds),
    /// The local geometry changed, too.
    Deformed(SweptBounds),
    /// The instance was moved out of the static batch into its own BLAS. Both BLASes changed.
    Detached(SweptBounds),
}

/// Bounds of an instance before and after a change, as far as it was and is visible.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SweptBounds {
    /// Bounds of the whole instance.
    pub(crate) bounds: Bounds,
    /// Bounds of parts: each of them contains some triangles, and every triangle before and after the change is in
    /// one of them.
    pub(crate) parts: Vec<Bounds>,
}

impl InstanceChange {
    /// Returns the bounds within which the scene may have changed.
    pub(crate) fn swept(&self) -> Option<&SweptBounds> {
        match self {
            Self::Unchanged => None,
            Self::Moved(swept) | Self::Deformed(swept) | Self::Detached(swept) => Some(swept),
        }
    }
}

/// An instance with its own body, in its current pose.
#[derive(Clone, Debug)]
pub(super) struct DynamicInstance {
    pub(super) instance: usize,
    pub(super) placement: Placement,
    pub(super) visible: bool,
    pub(super) bounds: Bounds,
    pub(super) blas: Arc<Blas>,
    /// Bounds in world space of the tree's nodes `cut`.
    parts: Vec<Bounds>,
    cut: Vec<u32>,
    /// Geometry of an instance whose vertices are posed one by one; `None` for one that was never posed that way.
    deformed: Option<DeformedGeometry>,
}

#[derive(Clone, Debug)]
struct DeformedGeometry {
    geometry: Geometry,
    scratch: Geometry,
    built_cost: f32,
}

/// Number of parts of a moving instance, to find what it comes near.
const SWEPT_PARTS: usize = 32;

/// A refitted tree is rebuilt once its cost exceeds the cost at its build by this factor.
const REBUILD_COST_RATIO: f32 = 1.6;

impl DynamicInstance {
    /// Creates an instance in a pose of its scene. `rest` is the tree of its mesh at rest, used unless it deforms.
    pub(super) fn posed(
        scene: &Arc<Scene>,
        pose: &ScenePose,
        index: usize,
        rest: Option<&Arc<Blas>>,
        shortcuts: Shortcuts,
    ) -> Self {
        let instance = &scene.instances()[index];
        let at = &pose.instances()[index];
        let (blas, deformed) = match rest {
            Some(blas) if instance.motion() != Motion::Deforming => (Arc::clone(blas), None),
            _ => {
                let mut geometry = Geometry::default();
                scene.local_geometry(InstanceId(index as u32), pose, &mut geometry);
                let blas = build(&PosedMesh::posed(scene, scene.rest(instance), &geometry), shortcuts);
                let deformed = DeformedGeometry::new(geometry, &blas);
                (Arc::new(blas), Some(deformed))
            }
        };
        Self { deformed, visible: at.visible(), ..Self::rigid(index, blas, placement(at.frame())) }
    }

    /// Creates a visible instance that does not deform.
    pub(super) fn rigid(instance: usize, blas: Arc<Blas>, placement: Placement) -> Self {
        let bounds = BlasInstance::new(Arc::clone(&blas), placement).bounds();
        let cut = blas.tree().cut(SWEPT_PARTS);
        let parts = parts(&blas, &cut, &placement);
        Self { instance, placement, visible: true, bounds, blas, parts, cut, deformed: None }
    }

    /// Returns the bytes held on the heap. The tree is not counted if it is `rest`, which instances share.
    pub(super) fn heap_bytes(&self, rest: Option<&Arc<Blas>>) -> usize {
        let shared = rest.is_some_and(|rest| Arc::ptr_eq(rest, &self.blas));
        let tree = if shared { 0 } else { self.blas.heap_bytes() };
        let shape = self
            .deformed
            .as_ref()
            .map_or(0, |shape| shape.geometry.heap_bytes() + shape.scratch.heap_bytes());
        tree + memory::list(&self.parts) + memory::list(&self.cut) + shape
    }

    /// Returns the geometry of an instance whose vertices are posed one by one, as of the last time they were posed.
    pub(super) fn geometry(&self) -> Option<&Geometry> {
        self.deformed.as_ref().map(|shape| &shape.geometry)
    }

    /// Moves the instance to another pose. Returns the change.
    pub(super) fn update(
        &mut self,
        scene: &Arc<Scene>,
        pose: &ScenePose,
        shortcuts: Shortcuts,
    ) -> InstanceChange {
        let at = &pose.instances()[self.instance];
        let now = placement(at.frame());
        let was_visible = std::mem::replace(&mut self.visible, at.visible());
        let moved = std::mem::replace(&mut self.placement, now) != now || was_visible != self.visible;
        // A hidden instance keeps its geometry: nothing refers to it, and its points are not kept up to date.
        let posed = self.visible || !shortcuts.contains(Shortcuts::HIDDEN);
        let (deformed, rebuilt) = if posed { self.deform(scene, pose, shortcuts) } else { (false, false) };
        if !moved && !deformed {
            return InstanceChange::Unchanged;
        }
        let bounds = BlasInstance::new(Arc::clone(&self.blas), now).bounds();
        let parts = parts(&self.blas, &self.cut, &now);
        let before =
            (std::mem::replace(&mut self.bounds, bounds), std::mem::replace(&mut self.parts, parts.clone()));
        let visible_bounds = |visible: bool, (bounds, parts): (Bounds, Vec<Bounds>)| {
            if visible {
                SweptBounds { bounds, parts }
            } else {
                SweptBounds { bounds: Bounds::EMPTY, parts: Vec::new() }
            }
        };
        let swept =
            visible_bounds(was_visible, before).with(visible_bounds(self.visible, (bounds, parts)), !rebuilt);
        if deformed { InstanceChange::Deformed(swept) } else { InstanceChange::Moved(swept) }
    }

    /// Updates the geometry of an instance whose vertices are posed one by one. Returns whether it counts as
    /// deformed, and whether its tree was rebuilt.
    fn deform(&mut self, scene: &Arc<Scene>, pose: &ScenePose, shortcuts: Shortcuts) -> (bool, bool) {
        let instance = &scene.instances()[self.instance];
        let deforming = instance.motion() == Motion::Deforming;
        if !deforming && shortcuts.contains(Shortcuts::RIGID) {
            return (false, false);
        }
        let blas = &mut self.blas;
        let at_rest = || DeformedGeometry::new(scene.rest(instance).geometry().clone(), blas);
        let shape = self.deformed.get_or_insert_with(at_rest);
        scene.local_geometry(InstanceId(self.instance as u32), pose, &mut shape.scratch);
        if deforming && shortcuts.contains(Shortcuts::SHAPES) && shape.scratch == shape.geometry {
            return (false, false);
        }
        std::mem::swap(&mut shape.scratch, &mut shape.geometry);
        let posed = PosedMesh::posed(scene, scene.rest(instance), &shape.geometry);
        let blas = Arc::make_mut(blas);
        blas.refit(&corners(&posed));
        let rebuilds = blas.cost() > REBUILD_COST_RATIO * shape.built_cost;
        if rebuilds {
            *blas = build(&posed, shortcuts);
            shape.built_cost = blas.cost();
            self.cut = blas.tree().cut(SWEPT_PARTS);
        }
        (deforming, rebuilds)
    }
}

impl DeformedGeometry {
    /// Creates the geometry for which a tree was built.
    fn new(geometry: Geometry, blas: &Blas) -> Self {
        Self { geometry, scratch: Geometry::default(), built_cost: blas.cost() }
    }
}

impl SweptBounds {
    /// Returns the union of both. If `paired`, the parts have the same triangles, and overlapping parts are merged.
    fn with(self, other: Self, paired: bool) -> Self {
        let bounds = self.bounds.union(other.bounds);
        if !paired || self.parts.len() != other.parts.len() {
            return Self { bounds, parts: [self.parts, other.parts].concat() };
        }
        let mut parts = Vec::with_capacity(self.parts.len());
        for (before, after) in self.parts.into_iter().zip(other.parts) {
            if before.touches(&after) {
                parts.push(before.union(after));
            } else {
                // The part jumped: nothing happened in between.
                parts.extend([before, after]);
            }
        }
        Self { bounds, parts }
    }
}

/// Returns the bounds in world space of some nodes of a body's tree.
fn parts(blas: &Blas, cut: &[u32], at: &Placement) -> Vec<Bounds> {
    let nodes = blas.tree().nodes();
    cut.iter().map(|&node| nodes[node as usize].bounds.transformed(at.rotation, at.translation)).collect()
}
