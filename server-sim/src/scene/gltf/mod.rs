//! glTF 2.0 files (`.gltf` and `.glb`). The `gltf` crate parses them without validation. Everything else is read with
//! checks of our own, because a file may contain any index or offset.

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

/// Selection of the animations of a file that play.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum AnimationChoice {
    /// All animations play at once. If two drive the same property of a node, the later one is used.
    All,
    /// No animation plays: the nodes have the transforms of the file.
    None,
    /// The animation with this name plays.
    Name(String),
    /// The animation with this index in the file plays.
    Index(usize),
}

/// One glTF file and its placement in the scene.
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
