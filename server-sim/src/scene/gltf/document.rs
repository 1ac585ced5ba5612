//! A glTF file with its buffers and images as bytes.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::schema::{BufferView, MeshoptCompression, Root};
use super::{container, extensions, meshopt, uri};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::io::{hash_file, read_file};
use crate::scene::limits;

/// A parsed file with its buffers.
pub(super) struct GltfDocument {
    pub(super) path: PathBuf,
    pub(super) root: Root,
    file: Vec<u8>,
    binary: Option<Range<usize>>,
    /// Buffers outside of this file that something refers to.
    buffers: BTreeMap<usize, Vec<u8>>,
    /// Buffer views that are compressed in the file.
    decompressed: BTreeMap<usize, Vec<u8>>,
    /// Numbers and pixels read so far. A small file must not become large by naming the same bytes over and over.
    numbers: Cell<u64>,
    pixels: Cell<u64>,
}

impl GltfDocument {
    /// Reads the file and the buffers that its buffer views refer to.
    pub(super) fn open(path: &Path, hasher: &mut blake3::Hasher) -> Result<Self, SceneError> {
        let file = read_file(path)?;
        hash_file(hasher, &file);
        let fail = |place: &str, problem| SceneError::Gltf {
            path: path.to_owned(),
            place: place.to_owned(),
            problem,
        };
        let chunks = container::split(&file).map_err(|problem| fail("the file's header", problem))?;
        let root = container::parse(&file[chunks.json])
            .map_err(|source| SceneError::NotGltf { path: path.to_owned(), source })?
            .map_err(|version| fail("asset.version", GltfProblem::Version(version)))?;
        if let Some(name) = extensions::unknown_required(&root) {
            return Err(fail("extensionsRequired", GltfProblem::Extension(name.to_owned())));
        }
        let mut document = Self {
            path: path.to_owned(),
            root,
            file,
            binary: chunks.binary,
            buffers: BTreeMap::new(),
            decompressed: BTreeMap::new(),
            numbers: Cell::new(0),
            pixels: Cell::new(0),
        };
        document.read_buffers(hasher)?;
        document.decompress_views()?;
        Ok(document)
    }

    /// Returns an error at a place of this file.
    pub(super) fn error(&self, place: impl Into<String>, problem: GltfProblem) -> SceneError {
        SceneError::Gltf { path: self.path.clone(), place: place.into(), problem }
    }

    /// Returns the element of one of the file's lists.
    pub(super) fn get<'a, T>(
        &self,
        what: &'static str,
        list: &'a [T],
        index: usize,
        place: &str,
    ) -> Result<&'a T, SceneError> {
        let missing = || self.error(place, GltfProblem::OutOfRange { what, index, count: list.len() });
        list.get(index).ok_or_else(missing)
    }

    /// Counts numbers before they are read.
    pub(super) fn spend_numbers(&self, count: u64, place: &str) -> Result<(), SceneError> {
        self.spend(&self.numbers, count, "numbers of all accessors", limits::MAX_NUMBERS, place)
    }

    /// Counts pixels before they are decoded.
    pub(super) fn spend_pixels(&self, count: u64, place: &str) -> Result<(), SceneError> {
        self.spend(&self.pixels, count, "pixels of all textures", limits::MAX_PIXELS, place)
    }

    fn spend(
        &self,
        spent: &Cell<u64>,
        more: u64,
        what: &'static str,
        limit: u64,
        place: &str,
    ) -> Result<(), SceneError> {
        let count = spent.get().saturating_add(more);
        spent.set(count);
        if count > limit {
            return Err(self.error(place, GltfProblem::TooMany { what, count, limit }));
        }
        Ok(())
    }

    /// Reads the buffers that any buffer view takes bytes from. Others are placeholders or of no use.
    fn read_buffers(&mut self, hasher: &mut blake3::Hasher) -> Result<(), SceneError> {
        let views = self.root.buffer_views.iter();
        let wanted: BTreeSet<usize> = views
            .map(|view| view.extensions.meshopt.as_ref().map_or(view.buffer, |packed| packed.buffer))
            .collect();
        for index in wanted {
            let Some(buffer) = self.root.buffers.get(index) else { continue };
            let Some(uri) = &buffer.uri else { continue };
            let place = format!("buffers[{index}]");
            let data = self.resolve(uri, &place, hasher)?;
            if (data.len() as u64) < buffer.byte_length {
                let available = data.len() as u64;
                let problem = GltfProblem::OutOfBytes { start: 0, end: buffer.byte_length, available };
                return Err(self.error(place, problem));
            }
            self.buffers.insert(index, data);
        }
        Ok(())
    }

    /// Returns the bytes of a URI: data within it, or a file beside this one, which is then part of the digest.
    pub(super) fn resolve(
        &self,
        uri: &str,
        place: &str,
        hasher: &mut blake3::Hasher,
    ) -> Result<Vec<u8>, SceneError> {
        match uri::resolve(uri).map_err(|why| self.error(place, GltfProblem::Uri(why)))? {
            uri::Target::Data(data) => Ok(data),
            uri::Target::Path(name) => {
                let path =
                    self.path.parent().map_or_else(|| PathBuf::from(&name), |folder| folder.join(&name));
                let data = read_file(&path)?;
                hash_file(hasher, &data);
                Ok(data)
            }
        }
    }

    /// Returns a range of a buffer.
    fn bytes(&self, buffer: usize, start: u64, length: u64, place: &str) -> Result<&[u8], SceneError> {
        let described = self.get("buffer", &self.root.buffers, buffer, place)?;
        let data = match (&described.uri, &self.binary) {
            (Some(_), _) => self.buffers.get(&buffer).map(Vec::as_slice),
            // Only the first buffer can be the binary chunk (glTF 2.0, section 4.4.3.3).
            (None, Some(chunk)) if buffer == 0 => self.file.get(chunk.clone()),
            (None, _) => None,
        };
        let absent = || self.error(format!("buffers[{buffer}]"), GltfProblem::Missing("its data (`uri`)"));
        slice(data.ok_or_else(absent)?, start, length).map_err(|problem| self.error(place, problem))
    }

    /// Returns the bytes of a buffer view and its stride, if it gives one.
    pub(super) fn view(&self, index: usize, place: &str) -> Result<(&[u8], Option<usize>), SceneError> {
        let view = self.get("buffer view", &self.root.buffer_views, index, place)?;
        if let Some(bytes) = self.decompressed.get(&index) {
            return Ok((bytes, view.byte_stride));
        }
        let place = format!("bufferViews[{index}]");
        Ok((self.bytes(view.buffer, view.byte_offset, view.byte_length, &place)?, view.byte_stride))
    }

    /// Returns the bytes of an image, and adds those of a file to the digest.
    pub(super) fn image(
        &self,
        index: usize,
        place: &str,
        hasher: &mut blake3::Hasher,
    ) -> Result<Cow<'_, [u8]>, SceneError> {
        let image = self.get("image", &self.root.images, index, place)?;
        let here = format!("images[{index}]");
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => self.resolve(uri, &here, hasher).map(Cow::Owned),
            (None, Some(view)) => Ok(Cow::Borrowed(self.view(view, &here)?.0)),
            (None, None) => Err(self.error(here, GltfProblem::Missing("uri or bufferView"))),
        }
    }

    /// Unpacks the views of `EXT_meshopt_compression` and `KHR_meshopt_compression`.
    fn decompress_views(&mut self) -> Result<(), SceneError> {
        let mut total = 0_u64;
        for (index, view) in self.root.buffer_views.iter().enumerate() {
            let Some(packed) = &view.extensions.meshopt else { continue };
            let place = format!("bufferViews[{index}]");
            total = view.byte_length.saturating_add(total);
            if total > limits::MAX_FILE_BYTES {
                let (what, limit) = ("bytes of decompressed buffer views", limits::MAX_FILE_BYTES);
                return Err(self.error(place, GltfProblem::TooMany { what, count: total, limit }));
            }
            let data = self.decompress(view, packed, &place)?;
            self.decompressed.insert(index, data);
        }
        Ok(())
    }

    fn decompress(
        &self,
        view: &BufferView,
        packed: &MeshoptCompression,
        place: &str,
    ) -> Result<Vec<u8>, SceneError> {
        let fail = |problem| self.error(place, problem);
        let length = packed.count.checked_mul(packed.byte_stride as u64);
        if length != Some(view.byte_length) {
            let (what, problem) =
                ("meshopt_compression", "count times byteStride is not byteLength".to_owned());
            return Err(fail(GltfProblem::Compressed { what, problem }));
        }
        let bytes = self.bytes(packed.buffer, packed.byte_offset, packed.byte_length, place)?;
        let layout = meshopt::Layout { count: packed.count as usize, stride: packed.byte_stride };
        let filter = packed.filter.as_deref().unwrap_or("NONE");
        meshopt::decode(&packed.mode, filter, layout, bytes).map_err(|error| {
            let (what, problem) = ("meshopt_compression", error.to_string());
            fail(GltfProblem::Compressed { what, problem })
        })
    }
}

/// Returns `length` bytes from `start`.
pub(super) fn slice(bytes: &[u8], start: u64, length: u64) -> Result<&[u8], GltfProblem> {
    let end = start.saturating_add(length);
    let outside = GltfProblem::OutOfBytes { start, end, available: bytes.len() as u64 };
    let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
    range.and_then(|(start, end)| bytes.get(start..end)).ok_or(outside)
}
