//! Nodes and skins of a glTF file.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json;

use super::document::GltfDocument;
use crate::scene::animation::unit_quaternion;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::model::{LocalTransform, Model, Skin};

/// Adds all nodes below one node for the part's placement. Returns the model's index of the file's first node.
pub(super) fn read(
    document: &GltfDocument,
    root: &LocalTransform,
    model: &mut Model,
) -> Result<usize, SceneError> {
    let nodes = &document.root.nodes;
    if nodes.len() > limits::MAX_NODES {
        let problem = GltfProblem::TooMany {
            what: "nodes",
            count: nodes.len() as u64,
            limit: limits::MAX_NODES as u64,
        };
        return Err(document.error("nodes", problem));
    }
    let parents = parents(document)?;
    let top = model.add_node(None, *root);
    let first = top + 1;
    for (i, node) in nodes.iter().enumerate() {
        let local = local_of(node).map_err(|problem| document.error(format!("nodes[{i}]"), problem))?;
        model.add_node(Some(parents[i].map_or(top, |parent| first + parent)), local);
    }
    Ok(first)
}

/// Returns the parent of each node. A hierarchy that is not a forest is an error.
fn parents(document: &GltfDocument) -> Result<Vec<Option<usize>>, SceneError> {
    let nodes = &document.root.nodes;
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for child in node.children.iter().flatten() {
            document.get("node", *child, &format!("nodes[{i}].children"))?;
            let slot = &mut parents[child.value()];
            if slot.replace(i).is_some() {
                return Err(document.error(format!("nodes[{}]", child.value()), GltfProblem::TwoParents));
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
        order.extend(nodes[node].children.iter().flatten().map(json::Index::value));
        at += 1;
    }
    match reached.iter().position(|reached| !reached) {
        Some(i) => Err(document.error(format!("nodes[{i}]"), GltfProblem::Cycle)),
        None => Ok(parents),
    }
}

/// Returns a node's own transform and checks its numbers.
fn local_of(node: &json::Node) -> Result<LocalTransform, GltfProblem> {
    if let Some(matrix) = &node.matrix {
        check(matrix)?;
        let m = DMat4::from_cols_array(&matrix.map(f64::from));
        return Ok(LocalTransform::Matrix(DAffine3::from_mat4(m)));
    }
    let translation = node.translation.unwrap_or([0.0; 3]);
    let rotation = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |q| q.0);
    let scale = node.scale.unwrap_or([1.0; 3]);
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

/// Adds the file's skins to the model. Returns the model's index of the first one.
pub(super) fn read_skins(
    document: &GltfDocument,
    first_node: usize,
    model: &mut Model,
) -> Result<usize, SceneError> {
    let first = model.skins.len();
    for (i, skin) in document.root.skins.iter().enumerate() {
        let place = format!("skins[{i}]");
        let count = skin.joints.len();
        if count == 0 {
            return Err(document.error(place, GltfProblem::Missing("a joint")));
        }
        if count > limits::MAX_JOINTS {
            let problem = GltfProblem::TooMany {
                what: "joints",
                count: count as u64,
                limit: limits::MAX_JOINTS as u64,
            };
            return Err(document.error(place, problem));
        }
        let mut joints = Vec::with_capacity(count);
        for joint in &skin.joints {
            document.get("node", *joint, &place)?;
            joints.push(first_node + joint.value());
        }
        let inverse_bind = match skin.inverse_bind_matrices {
            None => vec![DAffine3::IDENTITY; count],
            Some(accessor) => {
                let matrices = document.floats::<16>(accessor, &place)?;
                if matrices.len() < count {
                    let (what, found) = ("inverse bind matrices", matrices.len());
                    return Err(
                        document.error(place, GltfProblem::CountMismatch { what, expected: count, found })
                    );
                }
                let affine = |m: &[f32; 16]| DAffine3::from_mat4(DMat4::from_cols_array(&m.map(f64::from)));
                matrices[..count].iter().map(affine).collect()
            }
        };
        model.skins.push(Skin { joints, inverse_bind });
    }
    Ok(first)
}
