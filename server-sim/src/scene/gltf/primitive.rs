//! Primitives of a glTF file, and the nodes that show them.

use std::collections::BTreeMap;

use glam::{Vec2, Vec4};

use super::attributes::AttributeReader;
use super::document::GltfDocument;
use super::material::{MaterialUse, Materials, TexCoords};
use super::nodes::{FileNodes, check};
use super::schema::{Mesh, Node, Primitive};
use super::skin;
use super::triangles::Mode;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::model::{MeshNode, Model};
use crate::scene::raw_mesh::RawMesh;
use crate::scene::report::SceneReport;

/// Adds every primitive of every node of the file's scene, in node order.
pub(super) fn add_mesh_nodes(
    document: &GltfDocument,
    nodes: &FileNodes,
    materials: &Materials,
    first_skin: usize,
    model: &mut Model,
) -> Result<(), SceneError> {
    let mut reader = PrimitiveReader { document, materials, mesh_of_primitive: BTreeMap::new(), vertices: 0 };
    for (i, node) in document.root.nodes.iter().enumerate() {
        let Some(mesh) = node.mesh.filter(|_| nodes.shown[i]) else { continue };
        let place = format!("nodes[{i}]");
        let json = document.get("mesh", &document.root.meshes, mesh, &place)?;
        let skin = match node.skin {
            None => None,
            Some(skin) => {
                document.get("skin", &document.root.skins, skin, &place)?;
                Some(first_skin + skin)
            }
        };
        let weights = default_weights(node, json);
        check(weights).map_err(|problem| document.error(place.as_str(), problem))?;
        for (p, primitive) in json.primitives.iter().enumerate() {
            let Some(id) = reader.mesh(mesh, p, primitive, json.name.as_deref(), model)? else { continue };
            check_joints(document, model, id, skin, &place)?;
            let mut weights = weights.to_vec();
            weights.resize(model.meshes[id].morphs.len(), 0.0);
            let placements = nodes.placements(i);
            let count = model.mesh_nodes.len() + placements.len();
            if count > limits::MAX_INSTANCES {
                let (count, limit) = (count as u64, limits::MAX_INSTANCES as u64);
                return Err(document.error(place, GltfProblem::TooMany { what: "instances", count, limit }));
            }
            for (k, &at) in placements.iter().enumerate() {
                let copy = nodes.instances.contains_key(&i).then_some(k);
                let name = instance_name(node, json, copy, p);
                model.mesh_nodes.push(MeshNode { name, node: at, mesh: id, skin, weights: weights.clone() });
            }
        }
    }
    Ok(())
}

/// Returns the morph weights of a node's mesh. An empty list counts as none.
fn default_weights<'a>(node: &'a Node, mesh: &'a Mesh) -> &'a [f32] {
    let own = node.weights.as_deref().filter(|weights| !weights.is_empty());
    own.or(mesh.weights.as_deref()).unwrap_or_default()
}

/// Returns the name of the node or the mesh, with the numbers that tell copies and primitives apart.
fn instance_name(node: &Node, mesh: &Mesh, copy: Option<usize>, primitive: usize) -> String {
    let mut name = node.name.as_deref().or(mesh.name.as_deref()).unwrap_or_default().to_owned();
    if let Some(copy) = copy {
        name.push_str(&format!("#{copy}"));
    }
    if mesh.primitives.len() > 1 {
        name.push_str(&format!("[{primitive}]"));
    }
    name
}

/// Checks that a skin has all joints that a mesh follows.
fn check_joints(
    document: &GltfDocument,
    model: &Model,
    mesh: usize,
    skin: Option<usize>,
    place: &str,
) -> Result<(), SceneError> {
    if let (Some(skin), Some(weights)) = (skin, &model.meshes[mesh].skin) {
        let (joint, count) = (usize::from(weights.last_joint()), model.skins[skin].joints.len());
        if joint >= count {
            let problem = GltfProblem::OutOfRange { what: "joint", index: joint, count };
            return Err(document.error(place, problem));
        }
    }
    Ok(())
}

struct PrimitiveReader<'a> {
    document: &'a GltfDocument,
    materials: &'a Materials,
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
        let material = self.materials.of(self.document, primitive, &place)?;
        let raw = self.raw(primitive, material, &place, &mut model.report)?;
        let id = match raw {
            Some(raw) => {
                self.vertices += raw.positions.len().max(raw.triangles.len() * 3);
                if self.vertices > limits::MAX_VERTICES {
                    let (count, limit) = (self.vertices as u64, limits::MAX_VERTICES as u64);
                    let problem = GltfProblem::TooMany { what: "vertices", count, limit };
                    return Err(self.document.error(place, problem));
                }
                let name = name.unwrap_or_default().to_owned();
                model.add_mesh(RawMesh { name, ..raw }, material.material)
            }
            None => None,
        };
        self.mesh_of_primitive.insert((mesh, index), id);
        Ok(id)
    }

    /// Reads a primitive. Returns `None`, and counts the reason, if it has no surface.
    fn raw(
        &self,
        primitive: &Primitive,
        material: MaterialUse,
        place: &str,
        report: &mut SceneReport,
    ) -> Result<Option<RawMesh>, SceneError> {
        let document = self.document;
        let mode =
            Mode::new(primitive.mode).ok_or_else(|| document.error(place, GltfProblem::Invalid("mode")))?;
        match mode {
            Mode::Points => report.point_primitives += 1,
            Mode::Lines => report.line_primitives += 1,
            _ => {}
        }
        if matches!(mode, Mode::Points | Mode::Lines) {
            return Ok(None);
        }
        let attributes = AttributeReader::new(document, primitive, place)?;
        let Some(positions) = attributes.vectors("POSITION", None)? else {
            report.primitives_without_positions += 1;
            return Ok(None);
        };
        let count = positions.len();
        let triangles = match attributes.compressed_triangles() {
            Some(triangles) => triangles,
            None => {
                let (triangles, left_over) = mode.triangles(&self.corners(primitive, count, place)?);
                report.incomplete_primitives += usize::from(left_over);
                triangles
            }
        };
        let tangents = attributes.floats::<4>("TANGENT", Some(count))?;
        Ok(Some(RawMesh {
            name: String::new(),
            triangles,
            normals: attributes.vectors("NORMAL", Some(count))?,
            tangents: tangents.map(|list| list.into_iter().map(Vec4::from_array).collect()),
            uvs: uvs(&attributes, material.mask, count)?,
            normal_uvs: uvs(&attributes, material.normal, count)?,
            skin: skin::weights(&attributes, count)?,
            morphs: attributes.morphs(count)?,
            positions,
        }))
    }

    /// Returns the vertex of each corner.
    fn corners(&self, primitive: &Primitive, count: usize, place: &str) -> Result<Vec<u32>, SceneError> {
        let Some(accessor) = primitive.indices else { return Ok((0..count as u32).collect()) };
        let list = self.document.integers::<1>(accessor, place)?;
        if let Some([bad]) = list.iter().find(|v| v[0] as usize >= count) {
            let problem = GltfProblem::OutOfRange { what: "vertex", index: *bad as usize, count };
            return Err(self.document.error(format!("accessors[{accessor}]"), problem));
        }
        Ok(list.into_flattened())
    }
}

/// Reads the coordinates of a texture as its material places it.
fn uvs(
    attributes: &AttributeReader<'_>,
    coordinates: Option<TexCoords>,
    count: usize,
) -> Result<Option<Vec<Vec2>>, SceneError> {
    let Some(TexCoords { set, transform }) = coordinates else { return Ok(None) };
    let list = attributes.floats::<2>(&format!("TEXCOORD_{set}"), Some(count))?;
    let place = |uv: [f32; 2]| {
        let uv = Vec2::from_array(uv);
        let placed = transform.map_or(uv, |transform| transform.transform_point2(uv));
        // A product may be too large for a number; such a coordinate counts as 0 wherever it is used.
        if placed.is_finite() { placed } else { Vec2::ZERO }
    };
    Ok(list.map(|list| list.into_iter().map(place).collect()))
}
