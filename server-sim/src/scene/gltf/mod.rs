//! glTF 2.0 files (`.gltf` and `.glb`), with the extensions that affect surfaces and their motion.
//!
//! Everything is read with checks, because a file may contain any index, offset or number. What the specification says
//! to ignore is ignored and counted; what contradicts it is an error.

mod accessor;
mod animation;
mod attributes;
mod container;
mod document;
mod draco;
mod extensions;
mod instancing;
mod material;
mod meshopt;
mod nodes;
mod pointer;
mod primitive;
mod schema;
mod skin;
mod texture;
mod triangles;
mod uri;

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
    let unknown = extensions::unknown_used(&document.root).map(str::to_owned);
    model.report.unknown_extensions.extend(unknown);
    let mut nodes = nodes::read(&document, &part.root, model)?;
    instancing::read(&document, &mut nodes, model)?;
    let materials = material::read(&document, model, hasher)?;
    let skins = skin::read(&document, &nodes, model)?;
    primitive::add_mesh_nodes(&document, &nodes, &materials, skins, model)?;
    animation::read(&document, part, &nodes, model)
}
