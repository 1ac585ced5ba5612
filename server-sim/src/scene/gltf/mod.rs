//! glTF 2.0 files (`.gltf` and `.glb`): parsed by the `gltf` crate, everything behind that read with checks of
//! our own, because a file may point anywhere.

mod accessor;
mod animation;
mod document;
mod material;
mod nodes;
mod primitive;

#[cfg(test)]
pub(crate) mod tests;

use std::path::PathBuf;

use crate::scene::error::SceneError;
use crate::scene::model::{LocalTransform, Model};
use document::GltfDocument;

/// Which animations of a file play.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum AnimationChoice {
    /// All at once; where two drive the same property of a node, the later one counts.
    All,
    /// None: the nodes stand as the file has them.
    None,
    /// The one of this name.
    Name(String),
    /// The one at this place in the file.
    Index(usize),
}

/// One glTF file and how it is placed.
#[derive(Debug, Clone)]
pub(crate) struct ScenePart {
    pub(crate) path: PathBuf,
    pub(crate) play: AnimationChoice,
    pub(crate) root: LocalTransform,
    pub(crate) speed: f64,
    pub(crate) phase_s: f64,
}

/// Adds a part to a model, and the bytes of every file read to the digest.
pub(crate) fn load(
    part: &ScenePart,
    model: &mut Model,
    hasher: &mut blake3::Hasher,
) -> Result<(), SceneError> {
    let document = GltfDocument::open(&part.path, hasher)?;
    let first_node = nodes::read(&document, &part.root, model)?;
    let materials = material::read(&document, model, hasher)?;
    let skins = nodes::read_skins(&document, first_node, model)?;
    primitive::add_mesh_nodes(&document, first_node, &materials, skins, model)?;
    animation::read(&document, part, first_node, model)
}
