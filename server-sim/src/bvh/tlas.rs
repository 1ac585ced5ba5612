//! Bodies placed in the world by rigid transforms, and the search for those that a ray or a ball may touch.

use std::num::NonZeroU32;
use std::sync::Arc;

use glam::{Mat3, Vec3};
use psao_codec::memory;

use super::blas::{Blas, BlasHit};
use super::bounds::Bounds;
use super::tree::{Effort, Tree};

/// A rigid placement: `world = rotation * local + translation`. It preserves distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Proper rotation.
    pub rotation: Mat3,
    /// Translation in metres.
    pub translation: Vec3,
}

impl Placement {
    /// The placement of a local space that equals the world.
    pub const IDENTITY: Self = Self { rotation: Mat3::IDENTITY, translation: Vec3::ZERO };

    /// Transforms a local point to the world.
    #[must_use]
    pub fn point(&self, local: Vec3) -> Vec3 {
        self.rotation * local + self.translation
    }

    /// Transforms a local direction to the world.
    #[must_use]
    pub fn direction(&self, local: Vec3) -> Vec3 {
        self.rotation * local
    }

    /// Transforms a world point to local space.
    #[must_use]
    pub fn local_point(&self, world: Vec3) -> Vec3 {
        self.rotation.transpose() * (world - self.translation)
    }

    /// Transforms a world direction to local space.
    #[must_use]
    pub fn local_direction(&self, world: Vec3) -> Vec3 {
        self.rotation.transpose() * world
    }
}

/// A body: a BLAS placed in the world. Several bodies may share one BLAS.
#[derive(Clone, Debug)]
pub(crate) struct BlasInstance {
    pub(crate) blas: Arc<Blas>,
    pub(crate) placement: Placement,
    bounds: Bounds,
}

impl BlasInstance {
    pub(crate) fn new(blas: Arc<Blas>, placement: Placement) -> Self {
        let bounds = blas.bounds();
        let bounds = if placement == Placement::IDENTITY {
            bounds
        } else {
            bounds.transformed(placement.rotation, placement.translation)
        };
        Self { blas, placement, bounds }
    }

    /// Returns the bounds in the world.
    pub(crate) fn bounds(&self) -> Bounds {
        self.bounds
    }
}

/// Index of a body in its [`Tlas`], stored plus one, so that an `Option` of it has the same size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct BodyId(NonZeroU32);

impl BodyId {
    /// Returns the id of the body at `index`.
    #[inline(always)]
    pub(crate) fn new(index: u32) -> Self {
        Self(NonZeroU32::MIN.saturating_add(index))
    }

    /// Returns the index in the list of bodies.
    #[inline(always)]
    pub(crate) fn index(self) -> usize {
        self.0.get() as usize - 1
    }
}

/// Top-level acceleration structure: all bodies at a given time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tlas {
    list: Vec<BlasInstance>,
    top: Tree,
}

impl Tlas {
    pub(crate) fn new(list: Vec<BlasInstance>) -> Self {
        let boxes: Vec<Bounds> = list.iter().map(BlasInstance::bounds).collect();
        Self { top: Tree::build(&boxes, 2, 1, Effort::Quick), list }
    }

    /// Returns the bytes held, without the trees that bodies share.
    pub(crate) fn heap_bytes(&self) -> usize {
        memory::list(&self.list) + self.top.heap_bytes()
    }

    #[inline(always)]
    pub(crate) fn list(&self) -> &[BlasInstance] {
        &self.list
    }

    /// Returns the bounds of everything.
    pub(crate) fn bounds(&self) -> Bounds {
        self.top.bounds()
    }

    /// Collects in `near` the bodies with a leaf that touches the closed ball. Their order depends on the bodies
    /// only.
    pub(crate) fn near(&self, center: Vec3, radius: f32, stack: &mut Vec<u32>, near: &mut Vec<BodyId>) {
        near.clear();
        let limit = radius * radius;
        self.top.near(center, radius, stack, |body| {
            if self.list[body as usize].bounds.distance_squared(center) <= limit {
                near.push(BodyId::new(body));
            }
        });
        // The bounds of the static batch are those of the whole scene, so its leaves must be tested.
        near.retain(|&id| {
            let BlasInstance { blas, placement, .. } = &self.list[id.index()];
            blas.tree().touches(placement.local_point(center), radius, stack)
        });
    }

    /// Returns the nearest hit within `tmax` that `accept` accepts, with its body; with `any`, some hit.
    pub(crate) fn nearest(
        &self,
        origin: Vec3,
        direction: Vec3,
        tmax: f32,
        any: bool,
        accept: impl Fn(BodyId, &BlasHit) -> bool,
    ) -> Option<(BodyId, BlasHit)> {
        let inverse = direction.recip();
        let mut entered: Vec<(f32, u32)> = Vec::new();
        let enter = |bounds: &Bounds| bounds.entry(origin, inverse, tmax);
        self.top.leaves(
            &mut Vec::new(),
            |node| enter(&node.bounds).is_some(),
            |members| {
                let near = members
                    .iter()
                    .filter_map(|&member| Some((enter(&self.list[member as usize].bounds)?, member)));
                entered.extend(near);
            },
        );
        entered.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut best: Option<(BodyId, BlasHit)> = None;
        let mut limit = tmax;
        for (near, member) in entered {
            if near > limit {
                break;
            }
            let body = &self.list[member as usize];
            let (from, along) =
                (body.placement.local_point(origin), body.placement.local_direction(direction));
            let id = BodyId::new(member);
            let hit = body.blas.nearest(from, along, limit, any, |hit| accept(id, hit));
            if let Some(hit) = hit {
                limit = hit.intersection.t;
                best = Some((id, hit));
                if any {
                    break;
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::blas::reference;

    #[test]
    fn placed_bodies_are_hit_where_they_stand() {
        let cube = Arc::new(Blas::build(&reference::cube(0.5), Effort::Best));
        let turn = Mat3::from_rotation_y(0.7);
        let bodies = (0..5).map(|i| {
            let translation = Vec3::new(3.0 * i as f32, 0.0, 0.0);
            BlasInstance::new(Arc::clone(&cube), Placement { rotation: turn, translation })
        });
        let bodies = Tlas::new(bodies.collect());
        for i in 0..5u32 {
            let from = Vec3::new(3.0 * i as f32 + 0.1, 4.0, 0.1);
            let (body, hit) = bodies.nearest(from, Vec3::NEG_Y, 9.0, false, |_, _| true).unwrap();
            assert_eq!(body, BodyId::new(i));
            assert!((hit.intersection.t - 3.5).abs() < 1e-6);
            assert!(bodies.nearest(from, Vec3::NEG_Y, 3.4, true, |_, _| true).is_none());
            assert!(bodies.nearest(from, Vec3::NEG_Y, 9.0, true, |body, _| body != BodyId::new(i)).is_none());
        }
        let along = bodies.nearest(Vec3::new(20.0, 0.0, 0.0), Vec3::NEG_X, 99.0, false, |_, _| true).unwrap();
        assert_eq!(along.0, BodyId::new(4));
    }

    #[test]
    fn a_ball_meets_the_bodies_whose_leaves_it_touches() {
        let cube = Arc::new(Blas::build(&reference::cube(0.5), Effort::Best));
        let at = |x: f32| {
            BlasInstance::new(
                Arc::clone(&cube),
                Placement { translation: Vec3::X * x, ..Placement::IDENTITY },
            )
        };
        let bodies = Tlas::new((0..20).map(|i| at(2.0 * i as f32)).collect());
        let mut found = Vec::new();
        bodies.near(Vec3::X * 5.0, 0.51, &mut Vec::new(), &mut found);
        found.sort_unstable();
        assert_eq!(found, [BodyId::new(2), BodyId::new(3)]);
        // A ball between the parts of a body touches none of its leaves.
        let ends = [-9.0, 9.0].into_iter().flat_map(|z| {
            reference::cube(0.5).into_iter().map(move |triangle| triangle.map(|corner| corner + Vec3::Z * z))
        });
        let ends = Arc::new(Blas::build(&ends.collect::<Vec<_>>(), Effort::Best));
        let bodies = Tlas::new(vec![BlasInstance::new(ends, Placement::IDENTITY)]);
        for (z, count) in [(0.0, 0), (8.2, 1)] {
            bodies.near(Vec3::Z * z, 0.5, &mut Vec::new(), &mut found);
            assert_eq!(found.len(), count);
        }
        assert!(Tlas::new(Vec::new()).nearest(Vec3::ZERO, Vec3::X, 1.0, false, |_, _| true).is_none());
    }
}
