//! Nodes that show their mesh many times: `EXT_mesh_gpu_instancing`.

use super::document::GltfDocument;
use super::nodes::{FileNodes, trs};
use super::schema::InstancingAttributes;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::model::Model;

/// Adds a node of the model for each instance of the scene's instanced nodes.
pub(super) fn read(
    document: &GltfDocument,
    nodes: &mut FileNodes,
    model: &mut Model,
) -> Result<(), SceneError> {
    for (i, node) in document.root.nodes.iter().enumerate() {
        let Some(instancing) = node.extensions.instancing.as_ref().filter(|_| nodes.shown[i]) else {
            continue;
        };
        if node.mesh.is_none() {
            continue;
        }
        // Joints place a skinned mesh, whatever its node, so all instances would coincide.
        if node.skin.is_some() {
            model.report.skinned_instancing += 1;
            continue;
        }
        let place = format!("nodes[{i}].extensions.EXT_mesh_gpu_instancing");
        let added = add(document, &instancing.attributes, nodes.model(i), &place, model)?;
        nodes.instances.insert(i, added);
    }
    Ok(())
}

fn add(
    document: &GltfDocument,
    attributes: &InstancingAttributes,
    parent: usize,
    place: &str,
    model: &mut Model,
) -> Result<Vec<usize>, SceneError> {
    let InstancingAttributes { translation, rotation, scale } = *attributes;
    let Some(count) = count(document, attributes, model.nodes.len(), place)? else {
        return Ok(vec![parent]);
    };
    let translations = translation.map(|accessor| document.floats::<3>(accessor, place)).transpose()?;
    let rotations = rotation.map(|accessor| document.floats::<4>(accessor, place)).transpose()?;
    let scales = scale.map(|accessor| document.floats::<3>(accessor, place)).transpose()?;
    let mut added = Vec::with_capacity(count);
    for i in 0..count {
        let local = trs(
            translations.as_ref().map_or([0.0; 3], |list| list[i]),
            rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |list| list[i]),
            scales.as_ref().map_or([1.0; 3], |list| list[i]),
        );
        let local = local.map_err(|problem| document.error(format!("{place}, instance {i}"), problem))?;
        added.push(model.add_node(Some(parent), local));
    }
    Ok(added)
}

/// Returns the number of instances, or `None` if nothing says where they are. All attributes must agree, and the scene
/// must be able to hold the nodes.
fn count(
    document: &GltfDocument,
    attributes: &InstancingAttributes,
    before: usize,
    place: &str,
) -> Result<Option<usize>, SceneError> {
    let mut count = None;
    for accessor in [attributes.translation, attributes.rotation, attributes.scale].into_iter().flatten() {
        let found = document.accessor(accessor, place)?.count;
        let all = found.saturating_add(before as u64);
        if all > limits::MAX_NODES as u64 {
            let (what, limit) = ("nodes and instances", limits::MAX_NODES as u64);
            return Err(document.error(place, GltfProblem::TooMany { what, count: all, limit }));
        }
        let (found, expected) = (found as usize, *count.get_or_insert(found as usize));
        if found != expected {
            let what = "instances of an attribute";
            return Err(document.error(place, GltfProblem::CountMismatch { what, expected, found }));
        }
    }
    Ok(count)
}
