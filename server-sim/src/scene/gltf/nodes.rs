//! Nodes of a glTF file: their transforms, who their parents are, and which of them the scene shows.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::document::GltfDocument;
use super::schema::Node;
use crate::scene::animation::unit_quaternion;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::model::{LocalTransform, Model};

/// The file's nodes in the model.
pub(super) struct FileNodes {
    first: usize,
    /// Whether the file's scene has a node.
    pub(super) shown: Vec<bool>,
    /// Nodes of the model at which the mesh of an instanced node stands.
    pub(super) instances: BTreeMap<usize, Vec<usize>>,
}

impl FileNodes {
    /// Returns the model's index of a node.
    pub(super) fn model(&self, node: usize) -> usize {
        self.first + node
    }

    /// Returns the model's nodes at which the mesh of a node stands.
    pub(super) fn placements(&self, node: usize) -> Vec<usize> {
        self.instances.get(&node).cloned().unwrap_or_else(|| vec![self.model(node)])
    }
}

/// Adds all nodes below one node for the part's placement.
pub(super) fn read(
    document: &GltfDocument,
    root: &LocalTransform,
    model: &mut Model,
) -> Result<FileNodes, SceneError> {
    let nodes = &document.root.nodes;
    if nodes.len() > limits::MAX_NODES {
        let (count, limit) = (nodes.len() as u64, limits::MAX_NODES as u64);
        return Err(document.error("nodes", GltfProblem::TooMany { what: "nodes", count, limit }));
    }
    let parents = parents(document)?;
    let top = model.add_node(None, *root);
    let first = top + 1;
    for (i, node) in nodes.iter().enumerate() {
        let local = local_of(node).map_err(|problem| document.error(format!("nodes[{i}]"), problem))?;
        let added = model.add_node(Some(parents[i].map_or(top, |parent| first + parent)), local);
        let visibility = node.extensions.visibility.as_ref().and_then(|own| own.visible);
        model.nodes[added].visible = visibility.unwrap_or(true);
    }
    Ok(FileNodes { first, shown: shown_nodes(document)?, instances: BTreeMap::new() })
}

/// Returns the parent of each node. A hierarchy that is not a forest is an error.
fn parents(document: &GltfDocument) -> Result<Vec<Option<usize>>, SceneError> {
    let nodes = &document.root.nodes;
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for &child in &node.children {
            document.get("node", nodes, child, &format!("nodes[{i}].children"))?;
            if parents[child].replace(i).is_some() {
                return Err(document.error(format!("nodes[{child}]"), GltfProblem::TwoParents));
            }
        }
    }
    // Every node has at most one parent, so a node that no root reaches is on a cycle or below one.
    let mut order: Vec<usize> = (0..nodes.len()).filter(|&i| parents[i].is_none()).collect();
    let mut reached = vec![false; nodes.len()];
    let mut at = 0;
    while at < order.len() {
        let node = order[at];
        reached[node] = true;
        order.extend(&nodes[node].children);
        at += 1;
    }
    match reached.iter().position(|reached| !reached) {
        Some(i) => Err(document.error(format!("nodes[{i}]"), GltfProblem::Cycle)),
        None => Ok(parents),
    }
}

/// Returns which nodes belong to the file's scene: the scene that the file names, else its first one, else all nodes.
fn shown_nodes(document: &GltfDocument) -> Result<Vec<bool>, SceneError> {
    let (nodes, scenes) = (&document.root.nodes, &document.root.scenes);
    let scene = match document.root.scene {
        Some(scene) => Some(document.get("scene", scenes, scene, "scene")?),
        None => scenes.first(),
    };
    let Some(scene) = scene else { return Ok(vec![true; nodes.len()]) };
    let mut shown = vec![false; nodes.len()];
    let mut open = scene.nodes.clone();
    while let Some(index) = open.pop() {
        let node = document.get("node", nodes, index, "scenes")?;
        if !std::mem::replace(&mut shown[index], true) {
            open.extend(&node.children);
        }
    }
    Ok(shown)
}

/// Returns a node's own transform and checks its numbers.
fn local_of(node: &Node) -> Result<LocalTransform, GltfProblem> {
    if let Some(matrix) = &node.matrix {
        check(matrix)?;
        let m = DMat4::from_cols_array(&matrix.map(f64::from));
        return Ok(LocalTransform::Matrix(DAffine3::from_mat4(m)));
    }
    let translation = node.translation.unwrap_or([0.0; 3]);
    let rotation = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    trs(translation, rotation, node.scale.unwrap_or([1.0; 3]))
}

/// Returns the transform of a translation, a rotation and a scale, and checks their numbers.
pub(super) fn trs(
    translation: [f32; 3],
    rotation: [f32; 4],
    scale: [f32; 3],
) -> Result<LocalTransform, GltfProblem> {
    check(&translation)?;
    check(&rotation)?;
    check(&scale)?;
    Ok(LocalTransform::Trs {
        translation: DVec3::from_array(translation.map(f64::from)),
        rotation: unit_quaternion(DQuat::from_array(rotation.map(f64::from))),
        scale: DVec3::from_array(scale.map(f64::from)),
    })
}

/// Checks that numbers are finite and within the limit of magnitude.
pub(super) fn check(values: &[f32]) -> Result<(), GltfProblem> {
    for (element, value) in values.iter().enumerate() {
        if !value.is_finite() {
            return Err(GltfProblem::NonFinite { element });
        }
        if f64::from(value.abs()) > limits::MAX_MAGNITUDE {
            return Err(GltfProblem::TooFar { value: f64::from(*value), limit: limits::MAX_MAGNITUDE });
        }
    }
    Ok(())
}
