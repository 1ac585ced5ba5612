//! Skins of a glTF file, and the weights by which vertices follow their joints.

use glam::{DAffine3, DMat4};

use super::attributes::AttributeReader;
use super::document::GltfDocument;
use super::nodes::FileNodes;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::mesh::SkinWeights;
use crate::scene::model::{Model, Skin};

/// Adds the file's skins to the model. Returns the model's index of the first one.
pub(super) fn read(
    document: &GltfDocument,
    nodes: &FileNodes,
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
            let (count, limit) = (count as u64, limits::MAX_JOINTS as u64);
            return Err(document.error(place, GltfProblem::TooMany { what: "joints", count, limit }));
        }
        let mut joints = Vec::with_capacity(count);
        for &joint in &skin.joints {
            document.get("node", &document.root.nodes, joint, &place)?;
            joints.push(nodes.model(joint));
        }
        let inverse_bind = match skin.inverse_bind_matrices {
            None => vec![DAffine3::IDENTITY; count],
            Some(accessor) => inverse_bind(document, accessor, count, &place)?,
        };
        model.skins.push(Skin { joints, inverse_bind });
    }
    Ok(first)
}

fn inverse_bind(
    document: &GltfDocument,
    accessor: usize,
    count: usize,
    place: &str,
) -> Result<Vec<DAffine3>, SceneError> {
    let matrices = document.floats::<16>(accessor, place)?;
    if matrices.len() < count {
        let (what, found) = ("inverse bind matrices", matrices.len());
        return Err(document.error(place, GltfProblem::CountMismatch { what, expected: count, found }));
    }
    let affine = |m: &[f32; 16]| DAffine3::from_mat4(DMat4::from_cols_array(&m.map(f64::from)));
    Ok(matrices[..count].iter().map(affine).collect())
}

/// Returns the joints and weights of all sets for which the primitive has both.
pub(super) fn weights(
    attributes: &AttributeReader<'_>,
    count: usize,
) -> Result<Option<SkinWeights>, SceneError> {
    let mut sets = Vec::new();
    for set in 0.. {
        let (joints, weights) = (format!("JOINTS_{set}"), format!("WEIGHTS_{set}"));
        if !(attributes.has(&joints) && attributes.has(&weights)) {
            break;
        }
        let (Some(joints), Some(weights)) =
            (attributes.joints(&joints, count)?, attributes.floats::<4>(&weights, Some(count))?)
        else {
            break;
        };
        sets.push((joints, weights));
    }
    if sets.is_empty() {
        return Ok(None);
    }
    let mut skin = SkinWeights { sets: sets.len(), joints: Vec::new(), weights: Vec::new() };
    for v in 0..count {
        for (joints, weights) in &sets {
            skin.joints.push(joints[v]);
            skin.weights.push(weights[v]);
        }
    }
    Ok(Some(skin))
}
