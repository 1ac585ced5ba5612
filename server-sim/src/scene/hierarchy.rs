//! Nodes with visible descendants, and their world transforms at a given time.

use std::ops::Range;

use glam::{DAffine3, DQuat, DVec3};

use crate::scene::animation::{Property, unit_quaternion};
use crate::scene::model::{AnimationClip, Channel, LocalTransform, Model, Node};
use crate::scene::report::SceneReport;

/// One node, with the channels that drive it.
#[derive(Debug, Clone)]
struct HierarchyNode {
    parent: Option<usize>,
    local: LocalTransform,
    channels: Range<usize>,
    /// Whether its world transform can differ between two times.
    varies: bool,
    /// Whether it is visible unless a channel or a node above says otherwise.
    visible: bool,
    /// Whether it, or a node above it, can be hidden.
    hides: bool,
}

/// The node hierarchy, parents before children, reduced to the nodes and channels that affect something visible.
#[derive(Debug, Clone)]
pub(crate) struct NodeHierarchy {
    nodes: Vec<HierarchyNode>,
    channels: Vec<Channel>,
    clips: Vec<AnimationClip>,
    /// Index in `nodes` of each node of the model; `None` for nodes that nothing visible needs.
    indices: Vec<Option<usize>>,
}

impl NodeHierarchy {
    /// Selects all mesh nodes, their joints and the ancestors of both, with the channels that drive them.
    pub(crate) fn new(model: &Model, report: &mut SceneReport) -> Self {
        let order = needed_in_order(model);
        let mut indices = vec![None; model.nodes.len()];
        order.iter().enumerate().for_each(|(index, &node)| indices[node] = Some(index));
        let mut channels = pick_channels(model, &indices, report);
        channels.sort_by_key(|channel| channel.node);
        let mut nodes: Vec<HierarchyNode> = Vec::with_capacity(order.len());
        for (index, &node) in order.iter().enumerate() {
            let parent = model.nodes[node].parent.and_then(|p| indices[p]);
            let first = channels.partition_point(|c| c.node < index);
            let range = first..channels.partition_point(|c| c.node <= index);
            let own = &channels[range.clone()];
            let moves = |c: &Channel| c.property.moves() && c.curve.varies();
            let varies = parent.is_some_and(|p| nodes[p].varies) || own.iter().any(moves);
            let Node { local, visible, .. } = model.nodes[node];
            let hides = parent.is_some_and(|p| nodes[p].hides)
                || !visible
                || own.iter().any(|c| c.property == Property::Visibility);
            nodes.push(HierarchyNode { parent, local, channels: range, varies, visible, hides });
        }
        Self { nodes, channels, clips: model.clips.clone(), indices }
    }

    /// Returns the index of a node of the model. The node must be one that something visible needs.
    pub(crate) fn index_of(&self, node: usize) -> usize {
        self.indices[node].unwrap_or(0)
    }

    /// Returns the parent of a node.
    pub(crate) fn parent(&self, index: usize) -> Option<usize> {
        self.nodes[index].parent
    }

    /// Returns whether a node's world transform can differ between two times.
    pub(crate) fn varies(&self, index: usize) -> bool {
        self.nodes[index].varies
    }

    /// Returns whether a node can move relative to one of its ancestors (`None`: the world).
    pub(crate) fn varies_below(&self, index: usize, ancestor: Option<usize>) -> bool {
        let mut at = Some(index);
        while let Some(node) = at.filter(|_| at != ancestor) {
            let own = &self.channels[self.nodes[node].channels.clone()];
            if own.iter().any(|c| c.property.moves() && c.curve.varies()) {
                return true;
            }
            at = self.nodes[node].parent;
        }
        false
    }

    /// Computes the world transforms of all nodes at a given time.
    pub(crate) fn evaluate(&self, time_s: f64, worlds: &mut Vec<DAffine3>) {
        worlds.clear();
        for node in &self.nodes {
            let local = self.local_at(node, time_s).affine();
            let world = node.parent.map_or(local, |parent| worlds[parent] * local);
            worlds.push(world);
        }
    }

    fn local_at(&self, node: &HierarchyNode, time_s: f64) -> LocalTransform {
        let mut local = node.local;
        let LocalTransform::Trs { translation, rotation, scale } = &mut local else { return local };
        for channel in &self.channels[node.channels.clone()] {
            if !channel.property.moves() {
                continue;
            }
            let mut value = [0.0; 4];
            channel.curve.sample(self.clips[channel.clip].local_time(time_s), &mut value);
            let [x, y, z, w] = value;
            match channel.property {
                Property::Translation => *translation = DVec3::new(x, y, z),
                Property::Scale => *scale = DVec3::new(x, y, z),
                Property::Rotation => *rotation = unit_quaternion(DQuat::from_xyzw(x, y, z, w)),
                Property::Weights | Property::Visibility => {}
            }
        }
        local
    }

    /// Returns the channels of a node that drive one property.
    fn channels_of(&self, index: usize, property: Property) -> impl Iterator<Item = &Channel> {
        let own = &self.channels[self.nodes[index].channels.clone()];
        own.iter().filter(move |c| c.property == property)
    }

    /// Returns whether the morph weights at a node can differ between two times.
    pub(crate) fn weights_vary(&self, index: usize) -> bool {
        self.channels_of(index, Property::Weights).any(|c| c.curve.varies())
    }

    /// Returns a node and the nodes above it that can hide it. Most nodes have none.
    fn hiding(&self, index: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(index), |&node| self.nodes[node].parent)
            .take_while(|&node| self.nodes[node].hides)
    }

    /// Returns whether a node is visible at a given time.
    pub(crate) fn visible(&self, index: usize, time_s: f64) -> bool {
        self.hiding(index).all(|node| {
            let channel = self.channels_of(node, Property::Visibility).last();
            channel.map_or(self.nodes[node].visible, |channel| {
                let mut value = [0.0];
                channel.curve.sample(self.clips[channel.clip].local_time(time_s), &mut value);
                value[0] != 0.0
            })
        })
    }

    /// Returns whether a node can be visible at one time and hidden at another.
    pub(crate) fn visibility_varies(&self, index: usize) -> bool {
        self.hiding(index).any(|node| self.channels_of(node, Property::Visibility).any(|c| c.curve.varies()))
    }

    /// Returns whether some node above, or the node itself, hides it at all times.
    pub(crate) fn always_hidden(&self, index: usize) -> bool {
        self.hiding(index).any(|node| {
            let channel = self.channels_of(node, Property::Visibility).last();
            channel.map_or(!self.nodes[node].visible, |c| c.curve.values.iter().all(|value| *value == 0.0))
        })
    }

    /// Writes the morph weights of a node at a given time into `out`; they are `defaults` unless channels drive
    /// them.
    pub(crate) fn weights(&self, index: usize, defaults: &[f32], time_s: f64, out: &mut Vec<f32>) {
        out.clear();
        out.extend_from_slice(defaults);
        for channel in self.channels_of(index, Property::Weights) {
            let mut values = vec![0.0; channel.curve.width];
            channel.curve.sample(self.clips[channel.clip].local_time(time_s), &mut values);
            let driven = out.iter_mut().skip(channel.first);
            driven.zip(&values).for_each(|(slot, value)| *slot = *value as f32);
        }
    }
}

/// Returns all mesh nodes, their joints and the ancestors of both. Parents come first, otherwise nodes are
/// in file order.
fn needed_in_order(model: &Model) -> Vec<usize> {
    let mut order = Vec::new();
    let mut seen = vec![false; model.nodes.len()];
    let joints = |skin: usize| model.skins[skin].joints.iter().copied();
    for mesh_node in &model.mesh_nodes {
        let wanted = std::iter::once(mesh_node.node).chain(mesh_node.skin.into_iter().flat_map(joints));
        for node in wanted {
            let start = order.len();
            let mut at = Some(node);
            while let Some(n) = at.filter(|&n| !seen[n]) {
                seen[n] = true;
                order.push(n);
                at = model.nodes[n].parent;
            }
            order[start..].reverse();
        }
    }
    order
}

/// Returns the channels of the needed nodes, addressed by index in the hierarchy. Of several channels for one node
/// and the same numbers of a property, the last one is used.
fn pick_channels(model: &Model, indices: &[Option<usize>], report: &mut SceneReport) -> Vec<Channel> {
    let mut taken = std::collections::BTreeSet::new();
    let mut channels = Vec::new();
    for channel in model.channels.iter().rev() {
        let Some(index) = indices[channel.node] else {
            report.idle_channels += 1;
            continue;
        };
        if !taken.insert((index, channel.property as u8, channel.first, channel.curve.width)) {
            report.overruled_channels += 1;
        } else if channel.property.moves()
            && matches!(model.nodes[channel.node].local, LocalTransform::Matrix(_))
        {
            report.matrix_channels += 1;
        } else {
            channels.push(Channel { node: index, ..channel.clone() });
        }
    }
    channels.reverse();
    channels
}
