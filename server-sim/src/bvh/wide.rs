//! The inner nodes of a [`Tree`] with eight children each, so that eight boxes are tested at once.

use glam::Vec3;

use super::bounds::Bounds;
use super::lanes::{LANES, Packed3};
use super::tree::{Node, Tree, VACANT};

/// An inner node with up to eight children.
#[derive(Clone, Debug)]
pub(crate) struct WideNode {
    /// Corners of the children's boxes. A vacant lane has an empty box.
    pub(crate) low: Packed3,
    pub(crate) high: Packed3,
    pub(crate) children: [Child; LANES],
    /// The tree's nodes of the children, or [`VACANT`].
    nodes: [u32; LANES],
}

/// Reference to a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Child {
    /// The leaf of the tree with this index.
    Leaf(u32),
    /// The wide node with this index.
    Inner(u32),
    /// No child.
    Vacant,
}

/// Builds the wide nodes of a tree. Every leaf of the tree is below the first node once. The list is empty if the
/// tree is.
pub(crate) fn widen(tree: &Tree) -> Vec<WideNode> {
    let nodes = tree.nodes();
    let mut wide_nodes: Vec<WideNode> = Vec::new();
    let mut work: Vec<u32> = if nodes.is_empty() { Vec::new() } else { vec![0] };
    // Wide nodes are numbered in the order in which their roots enter the queue.
    let mut next = 0;
    while let Some(&root) = work.get(next) {
        next += 1;
        let (mut children, mut members) = ([Child::Vacant; LANES], [VACANT; LANES]);
        for ((child, slot), member) in children.iter_mut().zip(&mut members).zip(open(nodes, root)) {
            *slot = member;
            *child = if nodes[member as usize].count > 0 {
                Child::Leaf(member)
            } else {
                work.push(member);
                Child::Inner(work.len() as u32 - 1)
            };
        }
        wide_nodes.push(WideNode { low: Packed3::ZERO, high: Packed3::ZERO, children, nodes: members });
    }
    refit(&mut wide_nodes, tree);
    wide_nodes
}

/// Copies the boxes of the tree from which the nodes were built.
pub(crate) fn refit(wide_nodes: &mut [WideNode], tree: &Tree) {
    for WideNode { low, high, nodes, .. } in wide_nodes {
        let node = |lane: usize| tree.nodes().get(nodes[lane] as usize);
        let bounds = |lane: usize| node(lane).map_or(Bounds::EMPTY, |node| node.bounds);
        *low = Packed3::from_fn(|lane| bounds(lane).min());
        *high = Packed3::from_fn(|lane| bounds(lane).max());
    }
}

/// Returns at most eight nodes that together contain everything below a node. The largest nodes are split first.
fn open(nodes: &[Node], root: u32) -> Vec<u32> {
    let area = |node: u32| {
        let Vec3 { x, y, z } = nodes[node as usize].bounds.size();
        x * y + y * z + z * x
    };
    let mut open = vec![root];
    while open.len() < LANES {
        let inner = (0..open.len()).filter(|&i| nodes[open[i] as usize].count == 0);
        let Some(largest) = inner.max_by(|&a, &b| area(open[a]).total_cmp(&area(open[b]))) else { break };
        let first = nodes[open[largest] as usize].first;
        open[largest] = first;
        open.push(first + 1);
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Effort;

    #[test]
    fn every_leaf_is_below_the_first_node_once_within_the_boxes_on_the_way() {
        for count in [0, 1, 2, 9, 300] {
            let list: Vec<Bounds> =
                (0..count).map(|i| Bounds::new(Vec3::splat(i as f32), Vec3::splat(i as f32 + 0.5))).collect();
            let mut tree = Tree::build(&list, 2, 1, Effort::Best);
            let mut wide_nodes = widen(&tree);
            for shift in [0.0, 0.25] {
                tree.refit(|i| Bounds::new(list[i as usize].min() + shift, list[i as usize].max() + shift));
                refit(&mut wide_nodes, &tree);
                let mut found = Vec::new();
                let mut work: Vec<(usize, Bounds)> =
                    wide_nodes.first().map(|_| (0, tree.bounds())).into_iter().collect();
                while let Some((wide, within)) = work.pop() {
                    let WideNode { low, high, children, .. } = &wide_nodes[wide];
                    for (lane, child) in children.iter().enumerate() {
                        let bounds = Bounds::new(low.at(lane), high.at(lane));
                        assert_eq!(bounds.is_empty(), *child == Child::Vacant);
                        assert_eq!(within.union(bounds), within);
                        match *child {
                            Child::Leaf(node) => found.push((node, bounds)),
                            Child::Inner(wide) => work.push((wide as usize, bounds)),
                            Child::Vacant => {}
                        }
                    }
                }
                found.sort_unstable_by_key(|&(node, _)| node);
                let leaves = (0..).zip(tree.nodes()).filter(|(_, node)| node.count > 0);
                assert_eq!(found, leaves.map(|(i, node)| (i, node.bounds)).collect::<Vec<_>>());
            }
        }
    }
}
