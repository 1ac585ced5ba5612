//! A binary tree of boxes, built by `obvhs` (PLOC and reinsertion) and laid out for two kinds of traversal.
//!
//! A tree knows only boxes. Its leaves contain triangles in [`super::blas`] and whole bodies in [`super::tlas`].

use std::ops::Range;

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use psao_codec::memory;

use super::bounds::Bounds;

/// Marks a slot of [`Tree::order`] without a box: leaves are padded to whole blocks.
pub(crate) const VACANT: u32 = u32::MAX;

/// One node. It is a leaf if `count > 0`; its boxes are `order[first..first + count]`. Otherwise its children are at
/// `first` and `first + 1`. Children come after their parent, so that a refit is one backward pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub(crate) bounds: Bounds,
    pub(crate) first: u32,
    pub(crate) count: u32,
}

/// Effort for building a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Effort {
    /// For a tree that is built once and traversed often.
    Best,
    /// For a tree that is built every frame.
    Quick,
}

impl Effort {
    fn build(self, aabbs: &[Aabb]) -> Bvh2 {
        let indices = (0..aabbs.len() as u32).collect();
        let (search, threshold) = match self {
            Self::Best => (PlocSearchDistance::Medium, 3),
            Self::Quick => (PlocSearchDistance::Minimum, 0),
        };
        let mut builder = PlocBuilder::with_capacity(aabbs.len());
        let mut bvh = builder.build(search, aabbs, indices, SortPrecision::U64, threshold);
        if self == Self::Best {
            ReinsertionOptimizer::default().run(&mut bvh, 0.2, None);
        }
        bvh
    }
}

/// The tree. Without boxes it has no nodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Tree {
    /// Returns the bytes held on the heap.
    pub(super) fn heap_bytes(&self) -> usize {
        memory::list(&self.nodes) + memory::list(&self.order)
    }

    /// Builds the tree over `boxes`, ignoring empty and unbounded boxes. Leaves hold at most `leaf` boxes. Each
    /// leaf's run in [`Tree::order`] starts at a multiple of `stride` (1 = no padding).
    pub(crate) fn build(boxes: &[Bounds], leaf: usize, stride: usize, effort: Effort) -> Self {
        let equal_boxes = EqualBoxes::of(boxes);
        if equal_boxes.runs.is_empty() {
            return Self::default();
        }
        let aabbs: Vec<Aabb> = equal_boxes
            .runs
            .iter()
            .map(|run| boxes[equal_boxes.members[run.start] as usize])
            .map(|b| Aabb::new(b.min().into(), b.max().into()))
            .collect();
        let bvh = effort.build(&aabbs);
        let below = members_below(&bvh, &equal_boxes.runs);
        let mut tree =
            Self { nodes: vec![placeholder()], order: Vec::with_capacity(equal_boxes.members.len()) };
        let mut work = vec![(0usize, 0usize)];
        while let Some((source, target)) = work.pop() {
            let node = &bvh.nodes[source];
            let bounds = Bounds::new(node.aabb.min.into(), node.aabb.max.into());
            if below[source] as usize <= leaf {
                let first = tree.start_leaf(stride);
                collect_primitives(&bvh.nodes, source, |slot| {
                    let run = &equal_boxes.runs[bvh.primitive_indices[slot] as usize];
                    tree.order.extend_from_slice(&equal_boxes.members[run.clone()]);
                });
                tree.nodes[target] = Node { bounds, first, count: below[source] };
            } else if node.is_leaf() {
                let run = &equal_boxes.runs[bvh.primitive_indices[node.first_index as usize] as usize];
                tree.split_equal_boxes(target, bounds, &equal_boxes.members[run.clone()], leaf, stride);
            } else {
                let first = tree.nodes.len();
                tree.nodes.extend([placeholder(), placeholder()]);
                tree.nodes[target] = Node { bounds, first: first as u32, count: 0 };
                let child = node.first_index as usize;
                work.extend([(child + 1, first + 1), (child, first)]);
            }
        }
        tree.start_leaf(stride);
        tree
    }

    /// Pads [`Tree::order`] to the stride. Returns the start of the next leaf.
    fn start_leaf(&mut self, stride: usize) -> u32 {
        self.order.resize(self.order.len().next_multiple_of(stride), VACANT);
        self.order.len() as u32
    }

    /// Splits members with equal boxes into leaves, by number.
    fn split_equal_boxes(
        &mut self,
        target: usize,
        bounds: Bounds,
        members: &[u32],
        leaf: usize,
        stride: usize,
    ) {
        if members.len() <= leaf {
            let first = self.start_leaf(stride);
            self.order.extend_from_slice(members);
            self.nodes[target] = Node { bounds, first, count: members.len() as u32 };
            return;
        }
        let first = self.nodes.len();
        self.nodes.extend([placeholder(), placeholder()]);
        self.nodes[target] = Node { bounds, first: first as u32, count: 0 };
        // The left side has whole leaves, so that blocks are full. The depth is the logarithm of the number of
        // members.
        let (left, right) = members.split_at(members.len().div_ceil(leaf).div_ceil(2) * leaf);
        self.split_equal_boxes(first, bounds, left, leaf, stride);
        self.split_equal_boxes(first + 1, bounds, right, leaf, stride);
    }

    /// Returns the nodes, root first; empty for an empty tree.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Returns the box numbers in leaf order, with [`VACANT`] as padding.
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// Returns the bounds of everything in the tree.
    pub(crate) fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |root| root.bounds)
    }

    /// Returns at most `count` (at least 1) nodes that together contain everything. The largest nodes are split
    /// first.
    pub(crate) fn cut(&self, count: usize) -> Vec<u32> {
        let mut cut: Vec<u32> = if self.nodes.is_empty() { Vec::new() } else { vec![0] };
        let area = |node: u32| {
            let size = self.nodes[node as usize].bounds.size();
            size.x * size.y + size.y * size.z + size.z * size.x
        };
        while cut.len() < count {
            let inner = (0..cut.len()).filter(|&i| self.nodes[cut[i] as usize].count == 0);
            let Some(largest) = inner.max_by(|&a, &b| area(cut[a]).total_cmp(&area(cut[b]))) else { break };
            let first = self.nodes[cut[largest] as usize].first;
            cut[largest] = first;
            cut.push(first + 1);
        }
        cut
    }

    /// Recomputes all bounds from the current boxes. Each box stays in its leaf.
    pub(crate) fn refit(&mut self, bounds_of: impl Fn(u32) -> Bounds) {
        for index in (0..self.nodes.len()).rev() {
            let Node { first, count, .. } = self.nodes[index];
            let first = first as usize;
            let bounds = if count > 0 {
                let members = &self.order[first..first + count as usize];
                members.iter().fold(Bounds::EMPTY, |sum, &member| sum.union(bounds_of(member)))
            } else {
                self.nodes[first].bounds.union(self.nodes[first + 1].bounds)
            };
            self.nodes[index].bounds = bounds;
        }
    }

    /// Calls `visit` with every box number in a leaf that touches the closed ball (`center`, `radius`). Boxes of such
    /// a leaf may themselves be farther away: the caller tests them.
    pub(crate) fn near(&self, center: Vec3, radius: f32, stack: &mut Vec<u32>, mut visit: impl FnMut(u32)) {
        let limit = radius * radius;
        self.leaves(
            stack,
            |node| node.bounds.distance_squared(center) <= limit,
            |members| {
                members.iter().for_each(|&member| visit(member));
            },
        );
    }

    /// Returns whether a leaf touches the closed ball (`center`, `radius`).
    pub(crate) fn touches(&self, center: Vec3, radius: f32, stack: &mut Vec<u32>) -> bool {
        let limit = radius * radius;
        let within = |node: u32| self.nodes[node as usize].bounds.distance_squared(center) <= limit;
        stack.clear();
        if !self.nodes.is_empty() && within(0) {
            stack.push(0);
        }
        while let Some(index) = stack.pop() {
            let Node { first, count, .. } = self.nodes[index as usize];
            if count > 0 {
                return true;
            }
            stack.extend([first + 1, first].into_iter().filter(|&child| within(child)));
        }
        false
    }

    /// Calls `visit` with the members of every leaf whose node and ancestors all pass `enter`.
    pub(crate) fn leaves(
        &self,
        stack: &mut Vec<u32>,
        enter: impl Fn(&Node) -> bool,
        mut visit: impl FnMut(&[u32]),
    ) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !enter(node) {
                continue;
            }
            if node.count > 0 {
                visit(&self.order[node.first as usize..(node.first + node.count) as usize]);
            } else {
                stack.extend([node.first + 1, node.first]);
            }
        }
    }
}

fn placeholder() -> Node {
    Node { bounds: Bounds::EMPTY, first: 0, count: 0 }
}

/// Boxes in runs of equal ones. Clustering would chain equal boxes to a depth equal to their number, so it gets only
/// one box per run.
struct EqualBoxes {
    members: Vec<u32>,
    runs: Vec<Range<usize>>,
}

impl EqualBoxes {
    fn of(boxes: &[Bounds]) -> Self {
        let finite = |b: &Bounds| !b.is_empty() && b.min().is_finite() && b.max().is_finite();
        let key = |&i: &u32| {
            let b = &boxes[i as usize];
            (b.min().to_array().map(f32::to_bits), b.max().to_array().map(f32::to_bits))
        };
        let mut members: Vec<u32> = (0..).zip(boxes).filter(|(_, b)| finite(b)).map(|(i, _)| i).collect();
        members.sort_by_cached_key(key);
        let mut end = 0;
        let runs = members.chunk_by(|a, b| key(a) == key(b)).map(|run| {
            let start = end;
            end += run.len();
            start..end
        });
        let runs = runs.collect();
        Self { members, runs }
    }
}

/// Returns the number of members below each node. `obvhs` may order nodes freely after reinsertion, so this traverses
/// the tree.
fn members_below(bvh: &Bvh2, runs: &[Range<usize>]) -> Vec<u32> {
    let mut below = vec![0u32; bvh.nodes.len()];
    let mut walk = vec![(0usize, false)];
    while let Some((index, children_done)) = walk.pop() {
        let node = &bvh.nodes[index];
        let child = node.first_index as usize;
        if node.is_leaf() {
            let slots = child..child + node.prim_count as usize;
            below[index] = slots.map(|slot| runs[bvh.primitive_indices[slot] as usize].len() as u32).sum();
        } else if children_done {
            below[index] = below[child] + below[child + 1];
        } else {
            walk.extend([(index, true), (child, false), (child + 1, false)]);
        }
    }
    below
}

fn collect_primitives(nodes: &[Bvh2Node], root: usize, mut take: impl FnMut(usize)) {
    let mut walk = vec![root];
    while let Some(index) = walk.pop() {
        let node = &nodes[index];
        let first = node.first_index as usize;
        if node.is_leaf() {
            (first..first + node.prim_count as usize).for_each(&mut take);
        } else {
            walk.extend([first + 1, first]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = Vec<Bounds>> {
        let corner = prop::array::uniform3(-5f32..5.0);
        let size = prop::array::uniform3(prop_oneof![Just(0f32), 0f32..1.0]);
        prop::collection::vec(
            (corner, size).prop_map(|(c, s)| Bounds::new(c.into(), Vec3::from(c) + Vec3::from(s))),
            0..120,
        )
    }

    fn near_sorted(tree: &Tree, boxes: &[Bounds], center: Vec3, radius: f32) -> Vec<u32> {
        let mut found = Vec::new();
        tree.near(center, radius, &mut Vec::new(), |i| {
            if boxes[i as usize].distance_squared(center) <= radius * radius {
                found.push(i);
            }
        });
        found.sort_unstable();
        found
    }

    fn near_naive(boxes: &[Bounds], center: Vec3, radius: f32) -> Vec<u32> {
        (0..)
            .zip(boxes)
            .filter(|(_, b)| b.distance_squared(center) <= radius * radius)
            .map(|(i, _)| i)
            .collect()
    }

    proptest! {
        #[test]
        fn finds_the_same_boxes_as_a_scan_also_after_a_refit(
            list in boxes(), center in prop::array::uniform3(-6f32..6.0), radius in 0f32..3.0,
            leaf in 1usize..9, stride in prop_oneof![Just(1usize), Just(8)], quick in any::<bool>(),
        ) {
            let center = Vec3::from(center);
            let effort = if quick { Effort::Quick } else { Effort::Best };
            let mut tree = Tree::build(&list, leaf, stride, effort);
            prop_assert_eq!(near_sorted(&tree, &list, center, radius), near_naive(&list, center, radius));
            let moved: Vec<Bounds> =
                list.iter().map(|b| Bounds::new(b.min() * 1.5 - b.max() * 0.5, b.max() + 0.25)).collect();
            tree.refit(|i| moved[i as usize]);
            prop_assert_eq!(near_sorted(&tree, &moved, center, radius), near_naive(&moved, center, radius));
        }

        #[test]
        fn every_box_stands_in_one_leaf_and_leaves_start_on_the_stride(list in boxes(), leaf in 1usize..9) {
            let tree = Tree::build(&list, leaf, 8, Effort::Best);
            let mut members: Vec<u32> = tree.order().iter().copied().filter(|&i| i != VACANT).collect();
            members.sort_unstable();
            prop_assert_eq!(members, (0..list.len() as u32).collect::<Vec<_>>());
            for (index, node) in tree.nodes().iter().enumerate() {
                if node.count > 0 {
                    prop_assert!(node.count as usize <= leaf && node.first % 8 == 0);
                } else {
                    prop_assert!(node.first as usize > index);
                }
            }
        }
    }

    #[test]
    fn a_cut_holds_everything_once() {
        let list: Vec<Bounds> =
            (0..100).map(|i| Bounds::new(Vec3::X * i as f32, Vec3::X * i as f32 + 0.5)).collect();
        let tree = Tree::build(&list, 4, 1, Effort::Best);
        for count in [1, 5, 1000] {
            let cut = tree.cut(count);
            assert!(cut.len() <= count);
            let holders = |b: &Bounds| {
                let holds = |&&node: &&u32| {
                    tree.nodes()[node as usize].bounds.union(*b) == tree.nodes()[node as usize].bounds
                };
                cut.iter().filter(holds).count()
            };
            assert!(list.iter().all(|b| holders(b) == 1));
        }
        assert!(Tree::default().cut(3).is_empty());
    }

    #[test]
    fn empty_and_unbounded_boxes_are_left_out() {
        let bad = [Bounds::EMPTY, Bounds::new(Vec3::NAN, Vec3::NAN), Bounds::new(Vec3::ZERO, Vec3::INFINITY)];
        assert!(Tree::build(&bad, 4, 1, Effort::Best).nodes().is_empty());
        let mut some = bad.to_vec();
        some.push(Bounds::new(Vec3::ZERO, Vec3::ONE));
        assert_eq!(Tree::build(&some, 4, 1, Effort::Best).order(), [3]);
    }

    #[test]
    fn many_equal_boxes_build_and_are_all_found() {
        let list = vec![Bounds::new(Vec3::ONE, Vec3::ONE); 20_000];
        let tree = Tree::build(&list, 8, 8, Effort::Best);
        let mut depth = vec![0; tree.nodes().len()];
        for (index, node) in tree.nodes().iter().enumerate().filter(|(_, node)| node.count == 0) {
            for child in node.first as usize..node.first as usize + 2 {
                depth[child] = depth[index] + 1;
            }
        }
        assert!(depth.iter().max() < Some(&20));
        let mut found = 0;
        tree.near(Vec3::ONE, 0.0, &mut Vec::new(), |_| found += 1);
        assert_eq!(found, list.len());
    }
}
