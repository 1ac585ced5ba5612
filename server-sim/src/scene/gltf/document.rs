//! A glTF file with its buffers and images as bytes.

use std::path::{Path, PathBuf};

use gltf::json::{self, Index, Root};

use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::io::{hash_file, read_file};

/// Extensions that a file may require, because they do not affect what is read here.
const IGNORED_EXTENSIONS: [&str; 8] = [
    "KHR_lights_punctual",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_sheen",
    "KHR_materials_clearcoat",
    "KHR_materials_pbrSpecularGlossiness",
];

/// A parsed file with its buffers.
pub(super) struct GltfDocument {
    pub(super) path: PathBuf,
    pub(super) root: Root,
    buffers: Vec<Vec<u8>>,
}

impl GltfDocument {
    /// Reads the file and all of its buffers.
    pub(super) fn open(path: &Path, hasher: &mut blake3::Hasher) -> Result<Self, SceneError> {
        let bytes = read_file(path)?;
        hash_file(hasher, &bytes);
        let not_gltf = |source| SceneError::NotGltf { path: path.to_owned(), source: Box::new(source) };
        // The crate subtracts the size of the header from the length that a binary file claims.
        if bytes.starts_with(b"glTF") && bytes.get(8..12).is_some_and(|b| b[1..] == [0; 3] && b[0] < 12) {
            let claimed = u32::from(bytes[8]);
            let length = gltf::binary::Error::Length { length: claimed, length_read: bytes.len() };
            return Err(not_gltf(gltf::Error::Binary(length)));
        }
        let parsed = gltf::Gltf::from_slice_without_validation(&bytes).map_err(not_gltf)?;
        let mut document =
            Self { path: path.to_owned(), root: parsed.document.into_json(), buffers: Vec::new() };
        document.check_head()?;
        let mut blob = parsed.blob;
        for i in 0..document.root.buffers.len() {
            let buffer = document.read_buffer(i, &mut blob, hasher)?;
            document.buffers.push(buffer);
        }
        Ok(document)
    }

    /// Returns an error at a place of this file.
    pub(super) fn error(&self, place: impl Into<String>, problem: GltfProblem) -> SceneError {
        SceneError::Gltf { path: self.path.clone(), place: place.into(), problem }
    }

    /// Returns the element that an index refers to.
    pub(super) fn get<T>(&self, what: &'static str, index: Index<T>, place: &str) -> Result<&T, SceneError>
    where
        Root: json::root::Get<T>,
        T: Counted,
    {
        self.root.get(index).ok_or_else(|| {
            let problem = GltfProblem::OutOfRange { what, index: index.value(), count: T::count(&self.root) };
            self.error(place, problem)
        })
    }

    fn check_head(&self) -> Result<(), SceneError> {
        let version = &self.root.asset.version;
        if !version.starts_with("2.") {
            return Err(self.error("asset.version", GltfProblem::Unsupported(format!("version {version}"))));
        }
        let unknown =
            self.root.extensions_required.iter().find(|name| !IGNORED_EXTENSIONS.contains(&name.as_str()));
        match unknown {
            Some(name) => Err(self.error("extensionsRequired", GltfProblem::Unsupported(name.clone()))),
            None => Ok(()),
        }
    }

    fn read_buffer(
        &self,
        index: usize,
        blob: &mut Option<Vec<u8>>,
        hasher: &mut blake3::Hasher,
    ) -> Result<Vec<u8>, SceneError> {
        let place = format!("buffers[{index}]");
        let buffer = &self.root.buffers[index];
        let data = match &buffer.uri {
            Some(uri) => self.resolve(uri, &place, hasher)?,
            None => {
                blob.take().ok_or_else(|| self.error(&place, GltfProblem::Missing("the binary chunk")))?
            }
        };
        if (data.len() as u64) < buffer.byte_length.0 {
            let problem =
                GltfProblem::OutOfBytes { start: 0, end: buffer.byte_length.0, available: data.len() as u64 };
            return Err(self.error(place, problem));
        }
        Ok(data)
    }

    /// Returns the bytes of a URI: base64 data, or a file beside this one, which is then part of the digest.
    pub(super) fn resolve(
        &self,
        uri: &str,
        place: &str,
        hasher: &mut blake3::Hasher,
    ) -> Result<Vec<u8>, SceneError> {
        let bad = |why: String| self.error(place, GltfProblem::Uri(why));
        if uri.starts_with("data:") {
            return gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), None)
                .map(|data| data.0)
                .map_err(|error| bad(format!("data URI: {error}")));
        }
        if uri.contains(':') {
            return Err(bad(format!("`{uri}` is neither a data URI nor a relative path")));
        }
        let name = percent_decoded(uri).ok_or_else(|| bad(format!("`{uri}` is not UTF-8 once decoded")))?;
        let path = self.path.parent().map_or_else(|| PathBuf::from(&name), |folder| folder.join(&name));
        let data = read_file(&path)?;
        hash_file(hasher, &data);
        Ok(data)
    }

    /// Returns the bytes of a buffer view and its stride, if it gives one.
    pub(super) fn view(
        &self,
        index: Index<json::buffer::View>,
        place: &str,
    ) -> Result<(&[u8], Option<usize>), SceneError> {
        let view = self.get("buffer view", index, place)?;
        let place = format!("bufferViews[{}]", index.value());
        self.get("buffer", view.buffer, &place)?;
        let buffer = self.buffers.get(view.buffer.value()).map_or(&[] as &[u8], Vec::as_slice);
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let bytes = slice(buffer, start, view.byte_length.0).map_err(|problem| self.error(place, problem))?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }
}

/// Returns `length` bytes from `start`.
pub(super) fn slice(bytes: &[u8], start: u64, length: u64) -> Result<&[u8], GltfProblem> {
    let end = start.saturating_add(length);
    let outside = GltfProblem::OutOfBytes { start, end, available: bytes.len() as u64 };
    let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
    range.and_then(|(start, end)| bytes.get(start..end)).ok_or(outside)
}

/// Returns a URI with its `%XX` escapes resolved, or `None` if the result is not UTF-8.
fn percent_decoded(uri: &str) -> Option<String> {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let digits = bytes.get(i + 1..i + 3).filter(|_| bytes[i] == b'%');
        let digits = digits.filter(|d| d.iter().all(u8::is_ascii_hexdigit));
        match digits.and_then(|d| std::str::from_utf8(d).ok()).and_then(|d| u8::from_str_radix(d, 16).ok()) {
            Some(byte) => {
                out.push(byte);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    String::from_utf8(out).ok()
}

/// Number of elements of one kind in a document, for error messages.
pub(super) trait Counted: Sized {
    fn count(root: &Root) -> usize;
}

macro_rules! counted {
    ($($type:ty => $field:ident),* $(,)?) => {
        $(impl Counted for $type {
            fn count(root: &Root) -> usize {
                root.$field.len()
            }
        })*
    };
}

counted! {
    json::Accessor => accessors,
    json::buffer::View => buffer_views,
    json::Buffer => buffers,
    json::Image => images,
    json::Material => materials,
    json::Mesh => meshes,
    json::Node => nodes,
    json::Scene => scenes,
    json::Skin => skins,
    json::Texture => textures,
    json::texture::Sampler => samplers,
}

#[cfg(test)]
mod tests {
    use super::percent_decoded;

    #[test]
    fn percent_escapes_are_resolved() {
        assert_eq!(percent_decoded("a%20b.bin").as_deref(), Some("a b.bin"));
        assert_eq!(percent_decoded("50%.bin").as_deref(), Some("50%.bin"));
        assert_eq!(percent_decoded("%zz%4").as_deref(), Some("%zz%4"));
        assert_eq!(percent_decoded("%ff"), None);
    }
}
