//! Attributes of a primitive, from accessors or from a compressed mesh.

use glam::Vec3;

use super::document::GltfDocument;
use super::draco::DracoPrimitive;
use super::nodes::check;
use super::schema::{Attributes, Primitive};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::mesh::MorphTarget;

/// Reads the attributes of one primitive. Attributes of unknown names are never read.
pub(super) struct AttributeReader<'a> {
    document: &'a GltfDocument,
    primitive: &'a Primitive,
    place: &'a str,
    draco: Option<DracoPrimitive>,
}

impl<'a> AttributeReader<'a> {
    /// Unpacks the primitive if it is compressed.
    pub(super) fn new(
        document: &'a GltfDocument,
        primitive: &'a Primitive,
        place: &'a str,
    ) -> Result<Self, SceneError> {
        let packed = primitive.extensions.draco.as_ref();
        let draco = packed.map(|packed| DracoPrimitive::read(document, packed, place)).transpose()?;
        Ok(Self { document, primitive, place, draco })
    }

    /// Returns whether the primitive has an attribute.
    pub(super) fn has(&self, name: &str) -> bool {
        self.primitive.attributes.contains_key(name)
    }

    /// Returns the triangles of a compressed primitive.
    pub(super) fn compressed_triangles(&self) -> Option<Vec<[u32; 3]>> {
        self.draco.as_ref().map(DracoPrimitive::triangles)
    }

    /// Returns an attribute of the compressed mesh, if that has it.
    fn compressed(&self, name: &str, width: usize, normalized: bool) -> Result<Option<Vec<f32>>, SceneError> {
        let Some(draco) = self.draco.as_ref().filter(|draco| draco.has(name)) else { return Ok(None) };
        self.document.spend_numbers(draco.count() as u64 * width as u64, self.place)?;
        Ok(draco.floats(name, width, normalized))
    }

    /// Reads an attribute of `N` floats for each of `count` vertices, or for any number of them.
    pub(super) fn floats<const N: usize>(
        &self,
        name: &str,
        count: Option<usize>,
    ) -> Result<Option<Vec<[f32; N]>>, SceneError> {
        let Some(&accessor) = self.primitive.attributes.get(name) else { return Ok(None) };
        let normalized = self.document.accessor(accessor, self.place)?.normalized;
        let list = match self.compressed(name, N, normalized)? {
            Some(list) => {
                if let Some(bad) = list.iter().position(|v| !v.is_finite()) {
                    let problem = GltfProblem::NonFinite { element: bad / N };
                    return Err(self.document.error(format!("{}, {name}", self.place), problem));
                }
                list.as_chunks::<N>().0.to_vec()
            }
            None => {
                self.expect(accessor, count, name)?;
                self.document.floats::<N>(accessor, self.place)?
            }
        };
        Ok(Some(list))
    }

    /// Reads an attribute of vectors for each of `count` vertices, or for any number of them.
    pub(super) fn vectors(&self, name: &str, count: Option<usize>) -> Result<Option<Vec<Vec3>>, SceneError> {
        let Some(list) = self.floats::<3>(name, count)? else { return Ok(None) };
        let accessor = self.primitive.attributes.get(name).copied().unwrap_or_default();
        self.within_limits(list, accessor).map(Some)
    }

    /// Reads the numbers of four joints for each of `count` vertices.
    pub(super) fn joints(&self, name: &str, count: usize) -> Result<Option<Vec<[u16; 4]>>, SceneError> {
        let Some(&accessor) = self.primitive.attributes.get(name) else { return Ok(None) };
        let list = match self.compressed(name, 4, false)? {
            Some(list) => {
                list.as_chunks::<4>().0.iter().map(|joints| joints.map(|joint| joint as u32)).collect()
            }
            None => {
                self.expect(accessor, Some(count), name)?;
                self.document.integers::<4>(accessor, self.place)?
            }
        };
        if let Some(&large) = list.as_flattened().iter().find(|joint| u16::try_from(**joint).is_err()) {
            let problem = GltfProblem::OutOfRange { what: "joint", index: large as usize, count: 1 << 16 };
            return Err(self.document.error(self.place, problem));
        }
        Ok(Some(list.into_iter().map(|joints| joints.map(|joint| joint as u16)).collect()))
    }

    /// Reads the displacements of all morph targets.
    pub(super) fn morphs(&self, count: usize) -> Result<Vec<MorphTarget>, SceneError> {
        let read = |target: &Attributes, name: &str| match target.get(name) {
            Some(&accessor) => {
                self.expect(accessor, Some(count), name)?;
                self.within_limits(self.document.floats::<3>(accessor, self.place)?, accessor)
            }
            None => Ok(Vec::new()),
        };
        let target = |target: &Attributes| {
            let (positions, normals) = (read(target, "POSITION")?, read(target, "NORMAL")?);
            Ok(MorphTarget { positions, normals, tangents: read(target, "TANGENT")? })
        };
        self.primitive.targets.iter().map(target).collect()
    }

    fn within_limits(&self, list: Vec<[f32; 3]>, accessor: usize) -> Result<Vec<Vec3>, SceneError> {
        let here = || format!("accessors[{accessor}]");
        check(list.as_flattened()).map_err(|problem| self.document.error(here(), problem))?;
        Ok(list.into_iter().map(Vec3::from_array).collect())
    }

    /// Checks before it is read that an accessor has an element for each vertex.
    fn expect(&self, accessor: usize, expected: Option<usize>, name: &str) -> Result<(), SceneError> {
        let found = self.document.accessor(accessor, self.place)?.count as usize;
        match expected {
            Some(expected) if found != expected => {
                let place = format!("{}, {}", self.place, name.escape_debug());
                let what = "elements, as many as vertices";
                Err(self.document.error(place, GltfProblem::CountMismatch { what, expected, found }))
            }
            _ => Ok(()),
        }
    }
}
