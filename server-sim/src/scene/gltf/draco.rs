//! Primitives of `KHR_draco_mesh_compression`, unpacked by the crate `draco-core`.

use std::collections::BTreeMap;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};

use super::document::GltfDocument;
use super::schema::DracoCompression;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;

/// An unpacked primitive.
pub(super) struct DracoPrimitive {
    mesh: Mesh,
    /// Attributes of the mesh by name.
    ids: BTreeMap<String, u32>,
}

impl DracoPrimitive {
    /// Unpacks the mesh of a primitive.
    pub(super) fn read(
        document: &GltfDocument,
        packed: &DracoCompression,
        place: &str,
    ) -> Result<Self, SceneError> {
        let (bytes, _) = document.view(packed.buffer_view, place)?;
        let limits = DecodeLimits::default()
            .with_max_points(limits::MAX_VERTICES as u64)
            .with_max_faces(limits::MAX_TRIANGLES as u64)
            .with_max_decoded_bytes(limits::MAX_FILE_BYTES);
        let mut mesh = Mesh::new();
        let fail = |problem: String| {
            let what = "KHR_draco_mesh_compression";
            document.error(place, GltfProblem::Compressed { what, problem })
        };
        let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| fail(error.to_string()))?;
        let count = mesh.num_points();
        if mesh.faces().as_flattened().iter().any(|vertex| vertex.0 as usize >= count) {
            return Err(fail(format!("a triangle has a vertex beyond the {count} of the mesh")));
        }
        for (name, id) in &packed.attributes {
            if mesh.attribute_by_unique_id(*id).is_none() {
                return Err(fail(format!("the attribute {} ({id}) is missing", name.escape_debug())));
            }
        }
        Ok(Self { mesh, ids: packed.attributes.clone() })
    }

    /// Returns the number of vertices.
    pub(super) fn count(&self) -> usize {
        self.mesh.num_points()
    }

    /// Returns the vertex numbers of the triangles.
    pub(super) fn triangles(&self) -> Vec<[u32; 3]> {
        self.mesh.faces().iter().map(|face| face.map(|vertex| vertex.0)).collect()
    }

    /// Returns whether the mesh has an attribute.
    pub(super) fn has(&self, name: &str) -> bool {
        self.ids.contains_key(name)
    }

    /// Returns an attribute as floats, `width` for each vertex, or `None` if the mesh lacks it. Integers are scaled to
    /// 0..1 or -1..1 if the accessor is normalised.
    pub(super) fn floats(&self, name: &str, width: usize, normalized: bool) -> Option<Vec<f32>> {
        let attribute = self.mesh.attribute_by_unique_id(*self.ids.get(name)?)?;
        let mut values = attribute.read_f32s(self.count(), width);
        let most = match attribute.data_type() {
            DataType::Int8 => 127.0,
            DataType::Uint8 => 255.0,
            DataType::Int16 => 32_767.0,
            DataType::Uint16 => 65_535.0,
            _ => return Some(values),
        };
        if normalized {
            values.iter_mut().for_each(|value| *value = (*value / most).max(-1.0));
        }
        Some(values)
    }
}
