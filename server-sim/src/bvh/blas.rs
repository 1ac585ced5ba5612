//! The triangles of one body in its own space: a box tree whose leaves are blocks of eight triangles.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use glam::Vec3;
use psao_codec::memory;

use super::block::{Block, Intersection};
use super::bounds::Bounds;
use super::lanes::{LANES, Lanes, bits};
use super::tree::{Effort, Tree, VACANT};
use super::wide::{self, WideNode};

/// Bottom-level acceleration structure: a body's triangles, ready for rays. Triangles with a corner that is not
/// finite are ignored.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blas {
    tree: Tree,
    /// The same tree, for ray packets.
    wide_nodes: Vec<WideNode>,
    blocks: Vec<Block>,
    /// Bit per lane of each block: a hit must be checked against the mask. Empty if no triangle of the body is
    /// masked.
    masked: Vec<u8>,
}

/// The nearest intersection of a ray with a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BlasHit {
    pub(crate) intersection: Intersection,
    /// Index of the triangle in the list from which the body was built.
    pub(crate) triangle: u32,
}

impl Blas {
    /// Builds the structure from unmasked triangles.
    pub(crate) fn build(triangles: &[[Vec3; 3]], effort: Effort) -> Self {
        let boxes: Vec<Bounds> = triangles.iter().map(bounds_of).collect();
        let tree = Tree::build(&boxes, LANES, LANES, effort);
        let blocks = tree
            .order()
            .chunks(LANES)
            .map(|members| {
                let kept = members.iter().take_while(|&&member| member != VACANT);
                Block::new(&kept.map(|&member| triangles[member as usize]).collect::<Vec<_>>())
            })
            .collect();
        Self { wide_nodes: wide::widen(&tree), tree, blocks, masked: Vec::new() }
    }

    /// Returns the bytes held, including the struct itself.
    pub(crate) fn heap_bytes(&self) -> usize {
        let Self { tree, wide_nodes, blocks, masked } = self;
        size_of::<Self>()
            + tree.heap_bytes()
            + memory::list(wide_nodes)
            + memory::list(blocks)
            + memory::list(masked)
    }

    /// Marks the triangles whose hits must be checked against the mask.
    pub(crate) fn with_masks(mut self, is_masked: impl Fn(u32) -> bool) -> Self {
        let lanes = |members: &[u32]| {
            let bits = (0..).zip(members).filter(|&(_, &member)| member != VACANT && is_masked(member));
            bits.fold(0u8, |mask, (lane, _)| mask | 1 << lane)
        };
        let masked: Vec<u8> = self.tree.order().chunks(LANES).map(lanes).collect();
        self.masked = if masked.iter().all(|&mask| mask == 0) { Vec::new() } else { masked };
        self
    }

    /// Returns a bit per lane of the block of a leaf that starts at `first`: whether a hit must be checked against
    /// the mask.
    #[inline(always)]
    pub(crate) fn masked_lanes(&self, first: u32) -> u8 {
        self.masked.get(first as usize / LANES).copied().unwrap_or(0)
    }

    /// Moves the corners. `triangles` is as long as at the build, and each triangle stays in its leaf. Triangles with
    /// a corner that is not finite are ignored until the next refit.
    pub(crate) fn refit(&mut self, triangles: &[[Vec3; 3]]) {
        for (block, members) in self.blocks.iter_mut().zip(self.tree.order().chunks(LANES)) {
            for (lane, &member) in members.iter().enumerate().take_while(|&(_, &member)| member != VACANT) {
                block.set(lane, &triangles[member as usize]);
            }
        }
        self.tree.refit(|member| bounds_of(&triangles[member as usize]));
        wide::refit(&mut self.wide_nodes, &self.tree);
    }

    /// Returns the bounds of all triangles.
    pub(crate) fn bounds(&self) -> Bounds {
        self.tree.bounds()
    }

    /// Returns the expected work of a ray in the tree, for comparison with an earlier state of the same triangles. It
    /// is the ratio of the surface areas of all nodes to that of the root.
    pub(crate) fn cost(&self) -> f32 {
        let area = |bounds: &Bounds| {
            let size = bounds.size();
            f64::from(size.x * size.y + size.y * size.z + size.z * size.x)
        };
        let sum: f64 = self.tree.nodes().iter().map(|node| area(&node.bounds)).sum();
        (sum / area(&self.bounds()).max(f64::MIN_POSITIVE)) as f32
    }

    /// Returns the box tree.
    #[inline(always)]
    pub(crate) fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Returns the box tree with eight children per node, for ray packets. It is empty if the tree is.
    #[inline(always)]
    pub(crate) fn wide_nodes(&self) -> &[WideNode] {
        &self.wide_nodes
    }

    /// Returns the block of a leaf that starts at `first`.
    #[inline(always)]
    pub(crate) fn block(&self, first: u32) -> &Block {
        &self.blocks[first as usize / LANES]
    }

    /// Returns the index of the triangle in a lane of the block of a leaf that starts at `first`.
    #[inline(always)]
    pub(crate) fn triangle_at(&self, first: u32, lane: usize) -> u32 {
        self.tree.order()[first as usize + lane]
    }

    /// Returns the nearest triangle within `tmax` that `accept` accepts; with `any`, the first one found.
    pub(crate) fn nearest(
        &self,
        origin: Vec3,
        direction: Vec3,
        tmax: f32,
        any: bool,
        mut accept: impl FnMut(&BlasHit) -> bool,
    ) -> Option<BlasHit> {
        dispatch!(Level::new(), simd => self.nearest_by(simd, origin, direction, (tmax, any), &mut accept))
    }

    #[inline(always)]
    fn nearest_by<S: Simd>(
        &self,
        simd: S,
        origin: Vec3,
        direction: Vec3,
        (tmax, any): (f32, bool),
        accept: &mut impl FnMut(&BlasHit) -> bool,
    ) -> Option<BlasHit> {
        let inverse = direction.recip();
        let mut best: Option<BlasHit> = None;
        let mut limit = tmax;
        let mut stack: Vec<(f32, u32)> = Vec::with_capacity(64);
        let nodes = self.tree.nodes();
        let enter = |index: u32, limit: f32| nodes[index as usize].bounds.entry(origin, inverse, limit);
        if !nodes.is_empty()
            && let Some(near) = enter(0, limit)
        {
            stack.push((near, 0));
        }
        while let Some((near, index)) = stack.pop() {
            if near > limit {
                continue;
            }
            let node = &nodes[index as usize];
            if node.count == 0 {
                let left = enter(node.first, limit).map(|t| (t, node.first));
                let right = enter(node.first + 1, limit).map(|t| (t, node.first + 1));
                // Push the nearer child last, so that it is visited first.
                match (left, right) {
                    (Some(a), Some(b)) if a.0 <= b.0 => stack.extend([b, a]),
                    (Some(a), Some(b)) => stack.extend([a, b]),
                    (one, other) => stack.extend(one.or(other)),
                }
                continue;
            }
            let prepared = self.block(node.first).prepare(simd, origin);
            let nearer = bits(prepared.distances(simd, direction).simd_lt(Lanes::splat(simd, limit)));
            for lane in (0..node.count as usize).filter(|lane| nearer >> lane & 1 == 1) {
                let Some(intersection) = prepared.triangle(lane).intersect(direction) else { continue };
                let hit = BlasHit { intersection, triangle: self.triangle_at(node.first, lane) };
                if intersection.t < limit && accept(&hit) {
                    limit = intersection.t;
                    best = Some(hit);
                    if any {
                        return best;
                    }
                }
            }
        }
        best
    }
}

fn bounds_of(corners: &[Vec3; 3]) -> Bounds {
    if corners.iter().all(|corner| corner.is_finite()) { Bounds::around(*corners) } else { Bounds::EMPTY }
}

#[cfg(test)]
pub(crate) mod reference {
    //! A reference that tests every triangle, one by one.

    use super::*;

    /// Computes the same as [`Blas::nearest`] from the plain list.
    pub(crate) fn nearest(
        triangles: &[[Vec3; 3]],
        origin: Vec3,
        direction: Vec3,
        tmax: f32,
    ) -> Option<BlasHit> {
        nearest_of(triangles, origin, direction, tmax, |_| true)
    }

    /// Computes the same as [`nearest`] for the hits that `accept` accepts.
    pub(crate) fn nearest_of(
        triangles: &[[Vec3; 3]],
        origin: Vec3,
        direction: Vec3,
        tmax: f32,
        accept: impl Fn(&BlasHit) -> bool,
    ) -> Option<BlasHit> {
        dispatch!(Level::baseline(), simd => {
            let mut best: Option<BlasHit> = None;
            for (triangle, corners) in (0..).zip(triangles) {
                let prepared = Block::new(&[*corners]).prepare(simd, origin);
                let Some(intersection) = prepared.triangle(0).intersect(direction) else { continue };
                let hit = BlasHit { intersection, triangle };
                if intersection.t < best.map_or(tmax, |hit| hit.intersection.t) && accept(&hit) {
                    best = Some(hit);
                }
            }
            best
        })
    }

    /// Returns a box of 12 triangles around the origin.
    pub(crate) fn cube(half: f32) -> Vec<[Vec3; 3]> {
        let mut faces = Vec::new();
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let corner = |a: f32, b: f32| {
                    let mut at = [0.0; 3];
                    at[axis] = side * half;
                    at[(axis + 1) % 3] = a * half;
                    at[(axis + 2) % 3] = b * half;
                    Vec3::from(at)
                };
                faces.push([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]);
                faces.push([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
            }
        }
        faces
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn triangle_soup() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
        let corner = prop::array::uniform3(-2f32..2.0).prop_map(Vec3::from);
        let size = prop_oneof![Just(0f32), 0.01f32..2.0];
        let triangle = (corner, prop::array::uniform2(prop::array::uniform3(-1f32..1.0)), size)
            .prop_map(|(at, [b, c], size)| [at, at + Vec3::from(b) * size, at + Vec3::from(c) * size]);
        prop::collection::vec(triangle, 0..80)
    }

    fn check(blas: &Blas, triangles: &[[Vec3; 3]], origin: Vec3, direction: Vec3, tmax: f32) {
        let slow = reference::nearest(triangles, origin, direction, tmax);
        let fast = blas.nearest(origin, direction, tmax, false, |_| true);
        // Two triangles may be hit at the same distance, so only the distance is unique.
        assert_eq!(
            fast.map(|hit| hit.intersection.t.to_bits()),
            slow.map(|hit| hit.intersection.t.to_bits())
        );
        assert_eq!(blas.nearest(origin, direction, tmax, true, |_| true).is_some(), slow.is_some());
    }

    proptest! {
        #[test]
        fn finds_what_the_reference_finds(
            triangles in triangle_soup(), origin in prop::array::uniform3(-3f32..3.0),
            direction in prop::array::uniform3(-1f32..1.0), tmax in prop_oneof![Just(f32::INFINITY), 0.1f32..4.0],
            axis in prop::option::of(0usize..3),
        ) {
            let aimed = Vec3::from(direction).normalize_or_zero();
            let direction = axis.map_or(aimed, |axis| Vec3::AXES[axis]);
            prop_assume!(direction != Vec3::ZERO);
            let mut blas = Blas::build(&triangles, Effort::Best);
            check(&blas, &triangles, origin.into(), direction, tmax);
            let moved: Vec<_> = triangles.iter().map(|t| t.map(|c| Vec3::new(c.y, c.z, c.x) * 1.25 + 0.1)).collect();
            blas.refit(&moved);
            check(&blas, &moved, origin.into(), direction, tmax);
            let kept: Vec<_> = moved.iter().copied().step_by(2).collect();
            let without = |i: usize, t: &[Vec3; 3]| if i.is_multiple_of(2) { *t } else { [Vec3::NAN; 3] };
            blas.refit(&moved.iter().enumerate().map(|(i, t)| without(i, t)).collect::<Vec<_>>());
            check(&blas, &kept, origin.into(), direction, tmax);
        }
    }

    #[test]
    fn rays_in_the_plane_of_flat_boxes_and_through_nothing_are_safe() {
        let floor = [[Vec3::ZERO, Vec3::X, Vec3::Z], [Vec3::X, Vec3::Z, Vec3::X + Vec3::Z]];
        let blas = Blas::build(&floor, Effort::Best);
        assert_eq!(blas.nearest(Vec3::NEG_X, Vec3::X, 9.0, false, |_| true), None);
        assert!(blas.nearest(Vec3::new(0.3, 1.0, 0.3), Vec3::NEG_Y, 9.0, false, |_| true).is_some());
        let none = Blas::build(&[], Effort::Quick);
        assert_eq!(none.nearest(Vec3::ZERO, Vec3::X, 9.0, false, |_| true), None);
        assert!(none.bounds().is_empty());
    }

    #[test]
    fn corners_that_are_not_finite_never_reach_the_tree() {
        let list = [
            [Vec3::NAN, Vec3::X, Vec3::Y],
            [Vec3::ZERO, Vec3::X, Vec3::INFINITY],
            [Vec3::ZERO, Vec3::X, Vec3::Y],
        ];
        let blas = Blas::build(&list, Effort::Best);
        let hit = blas.nearest(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z, 9.0, false, |_| true).unwrap();
        assert_eq!(hit.triangle, 2);
    }

    #[test]
    fn refused_hits_let_the_ray_go_on() {
        let list: Vec<_> =
            (0..4).map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|c| c - Vec3::Z * i as f32)).collect();
        let blas = Blas::build(&list, Effort::Best);
        let from = Vec3::new(0.2, 0.2, 1.0);
        let hit = blas.nearest(from, Vec3::NEG_Z, 9.0, false, |hit| hit.triangle >= 2).unwrap();
        assert_eq!((hit.triangle, hit.intersection.t), (2, 3.0));
        assert_eq!(reference::cube(1.0).len(), 12);
    }
}
