//! Primitives of a glTF file: attributes, triangles, and the nodes that show them.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3, Vec4};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Index};

use super::document::GltfDocument;
use super::material::MaterialUse;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::mesh::{MorphTarget, SkinWeights};
use crate::scene::model::{MeshNode, Model};
use crate::scene::raw_mesh::RawMesh;

/// Adds every primitive of every node of the file's scene, in node order.
pub(super) fn add_mesh_nodes(
    document: &GltfDocument,
    first_node: usize,
    materials: &[MaterialUse],
    first_skin: usize,
    model: &mut Model,
) -> Result<(), SceneError> {
    let mut reader = PrimitiveReader { document, materials, mesh_of_primitive: BTreeMap::new(), vertices: 0 };
    let shown = shown_nodes(document)?;
    for (i, node) in document.root.nodes.iter().enumerate() {
        let Some(mesh) = node.mesh.filter(|_| shown[i]) else { continue };
        let place = format!("nodes[{i}]");
        let json = document.get("mesh", mesh, &place)?;
        let skin = match node.skin {
            None => None,
            Some(skin) => {
                document.get("skin", skin, &place)?;
                Some(first_skin + skin.value())
            }
        };
        let name = node.name.as_deref().or(json.name.as_deref()).unwrap_or_default();
        for (p, primitive) in json.primitives.iter().enumerate() {
            let Some(id) = reader.mesh(mesh.value(), p, primitive, json.name.as_deref(), model)? else {
                continue;
            };
            let placed = &model.meshes[id];
            if let (Some(skin), Some(weights)) = (skin, &placed.skin) {
                let (joint, count) = (usize::from(weights.last_joint()), model.skins[skin].joints.len());
                if joint >= count {
                    let problem = GltfProblem::OutOfRange { what: "joint", index: joint, count };
                    return Err(document.error(place, problem));
                }
            }
            let mut weights = node.weights.clone().or_else(|| json.weights.clone()).unwrap_or_default();
            super::nodes::check(&weights).map_err(|problem| document.error(place.as_str(), problem))?;
            weights.resize(placed.morphs.len(), 0.0);
            let name = if json.primitives.len() > 1 { format!("{name}[{p}]") } else { name.to_owned() };
            model.mesh_nodes.push(MeshNode { name, node: first_node + i, mesh: id, skin, weights });
        }
    }
    Ok(())
}

/// Returns which nodes belong to the file's scene: the scene that the file names, else its first one, else all nodes.
fn shown_nodes(document: &GltfDocument) -> Result<Vec<bool>, SceneError> {
    let nodes = &document.root.nodes;
    let scene = match document.root.scene {
        Some(scene) => Some(document.get("scene", scene, "scene")?),
        None => document.root.scenes.first(),
    };
    let Some(scene) = scene else { return Ok(vec![true; nodes.len()]) };
    let mut shown = vec![false; nodes.len()];
    let mut open = scene.nodes.clone();
    while let Some(index) = open.pop() {
        let node = document.get("node", index, "scenes")?;
        if !std::mem::replace(&mut shown[index.value()], true) {
            open.extend(node.children.iter().flatten());
        }
    }
    Ok(shown)
}

struct PrimitiveReader<'a> {
    document: &'a GltfDocument,
    materials: &'a [MaterialUse],
    /// Model mesh of each primitive read so far; `None` for a primitive without a surface.
    mesh_of_primitive: BTreeMap<(usize, usize), Option<usize>>,
    vertices: usize,
}

impl PrimitiveReader<'_> {
    /// Returns the index of a primitive's mesh in the model.
    fn mesh(
        &mut self,
        mesh: usize,
        index: usize,
        primitive: &Primitive,
        name: Option<&str>,
        model: &mut Model,
    ) -> Result<Option<usize>, SceneError> {
        if let Some(known) = self.mesh_of_primitive.get(&(mesh, index)) {
            return Ok(*known);
        }
        let place = format!("meshes[{mesh}].primitives[{index}]");
        let material = match primitive.material {
            Some(material) => {
                self.document.get("material", material, &place)?;
                self.materials[material.value()]
            }
            None => self.materials[self.materials.len() - 1],
        };
        let raw = self.raw(primitive, material, &place)?;
        let id = match raw {
            Some(raw) => {
                self.vertices += raw.positions.len().max(raw.triangles.len() * 3);
                if self.vertices > limits::MAX_VERTICES {
                    let (count, limit) = (self.vertices as u64, limits::MAX_VERTICES as u64);
                    return Err(self
                        .document
                        .error(place, GltfProblem::TooMany { what: "vertices", count, limit }));
                }
                model
                    .add_mesh(RawMesh { name: name.unwrap_or_default().to_owned(), ..raw }, material.material)
            }
            None => {
                model.report.point_or_line_primitives += 1;
                None
            }
        };
        self.mesh_of_primitive.insert((mesh, index), id);
        Ok(id)
    }

    /// Reads a primitive. Returns `None` if it consists of points or lines.
    fn raw(
        &self,
        primitive: &Primitive,
        material: MaterialUse,
        place: &str,
    ) -> Result<Option<RawMesh>, SceneError> {
        let document = self.document;
        let Checked::Valid(mode) = primitive.mode else {
            return Err(document.error(place, GltfProblem::Invalid("mode")));
        };
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let positions = attribute(Semantic::Positions)
            .ok_or_else(|| document.error(place, GltfProblem::Missing("the attribute POSITION")))?;
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(None);
        }
        let positions = vectors(document, positions, place)?;
        let count = positions.len();
        let list3 = |semantic, what| {
            attribute(semantic)
                .map(|a| same_length(document, vectors(document, a, place)?, count, what, place))
                .transpose()
        };
        let normals = list3(Semantic::Normals, "NORMAL")?;
        let tangents = attribute(Semantic::Tangents)
            .map(|a| same_length(document, document.floats::<4>(a, place)?, count, "TANGENT", place))
            .transpose()?;
        let uvs = |set: Option<u32>| {
            set.and_then(|set| attribute(Semantic::TexCoords(set)))
                .map(|a| same_length(document, document.floats::<2>(a, place)?, count, "TEXCOORD", place))
                .transpose()
                .map(|list| list.map(|list| list.into_iter().map(Vec2::from_array).collect()))
        };
        Ok(Some(RawMesh {
            name: String::new(),
            triangles: triangles(document, primitive, mode, count, place)?,
            normals,
            tangents: tangents.map(|list| list.into_iter().map(Vec4::from_array).collect()),
            uvs: uvs(material.mask_set)?,
            normal_uvs: uvs(material.normal_set)?,
            skin: skin_weights(document, primitive, count, place)?,
            morphs: morphs(document, primitive, count, place)?,
            positions,
        }))
    }
}

/// Reads vectors of three floats within the limit of magnitude.
fn vectors(document: &GltfDocument, accessor: Index<Accessor>, place: &str) -> Result<Vec<Vec3>, SceneError> {
    let list = document.floats::<3>(accessor, place)?;
    let here = || format!("accessors[{}]", accessor.value());
    super::nodes::check(list.as_flattened()).map_err(|problem| document.error(here(), problem))?;
    Ok(list.into_iter().map(Vec3::from_array).collect())
}

fn same_length<T>(
    document: &GltfDocument,
    list: Vec<T>,
    expected: usize,
    what: &'static str,
    place: &str,
) -> Result<Vec<T>, SceneError> {
    if list.len() == expected {
        Ok(list)
    } else {
        Err(document.error(place, GltfProblem::CountMismatch { what, expected, found: list.len() }))
    }
}

/// Returns the vertex numbers of the triangles in any of the three triangle modes (glTF 2.0, section 3.7.2.1).
fn triangles(
    document: &GltfDocument,
    primitive: &Primitive,
    mode: Mode,
    count: usize,
    place: &str,
) -> Result<Vec<[u32; 3]>, SceneError> {
    let corners: Vec<u32> = match primitive.indices {
        None => (0..count as u32).collect(),
        Some(accessor) => {
            let list = document.integers::<1>(accessor, place)?;
            if let Some(bad) = list.iter().find(|v| v[0] as usize >= count) {
                let here = format!("accessors[{}]", accessor.value());
                return Err(document
                    .error(here, GltfProblem::OutOfRange { what: "vertex", index: bad[0] as usize, count }));
            }
            list.as_flattened().to_vec()
        }
    };
    match mode {
        Mode::TriangleStrip => {
            let odd =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            Ok(corners.windows(3).enumerate().map(odd).collect())
        }
        Mode::TriangleFan => {
            Ok(corners.get(1..).unwrap_or_default().windows(2).map(|w| [w[0], w[1], corners[0]]).collect())
        }
        _ => {
            let (whole, rest) = corners.as_chunks::<3>();
            if rest.is_empty() {
                return Ok(whole.to_vec());
            }
            let (expected, found) = (whole.len() * 3, corners.len());
            Err(document
                .error(place, GltfProblem::CountMismatch { what: "corners of triangles", expected, found }))
        }
    }
}

/// Returns the joints and weights of all sets for which the primitive has both.
fn skin_weights(
    document: &GltfDocument,
    primitive: &Primitive,
    count: usize,
    place: &str,
) -> Result<Option<SkinWeights>, SceneError> {
    let mut sets = Vec::new();
    for set in 0.. {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let pair = attribute(Semantic::Joints(set)).zip(attribute(Semantic::Weights(set)));
        let Some((joints, weights)) = pair else { break };
        let joints = same_length(document, document.integers::<4>(joints, place)?, count, "JOINTS", place)?;
        let weights = same_length(document, document.floats::<4>(weights, place)?, count, "WEIGHTS", place)?;
        if let Some(&large) = joints.as_flattened().iter().find(|joint| u16::try_from(**joint).is_err()) {
            let (index, count) = (large as usize, 1 << 16);
            return Err(document.error(place, GltfProblem::OutOfRange { what: "joint", index, count }));
        }
        sets.push((joints, weights));
    }
    if sets.is_empty() {
        return Ok(None);
    }
    let mut skin = SkinWeights { sets: sets.len(), joints: Vec::new(), weights: Vec::new() };
    for v in 0..count {
        for (joints, weights) in &sets {
            skin.joints.push(joints[v].map(|joint| joint as u16));
            skin.weights.push(weights[v]);
        }
    }
    Ok(Some(skin))
}

fn morphs(
    document: &GltfDocument,
    primitive: &Primitive,
    count: usize,
    place: &str,
) -> Result<Vec<MorphTarget>, SceneError> {
    let read = |accessor: Option<Index<Accessor>>| match accessor {
        Some(a) => {
            same_length(document, vectors(document, a, place)?, count, "a morph target's elements", place)
        }
        None => Ok(Vec::new()),
    };
    let target = |target: &gltf::json::mesh::MorphTarget| {
        let (positions, normals) = (read(target.positions)?, read(target.normals)?);
        Ok(MorphTarget { positions, normals, tangents: read(target.tangents)? })
    };
    primitive.targets.iter().flatten().map(target).collect()
}
