//! Errors of scene loading. Each error names the file, the place in it and what to do.

use std::path::PathBuf;

/// Reason why a scene could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The argument is not a built-in scene and has no known file extension.
    #[error("`{name}` is neither a built-in scene ({}) nor a .toml, .gltf or .glb file", builtin.join(", "))]
    UnknownScene {
        /// The name as given.
        name: String,
        /// Names of the built-in scenes.
        builtin: &'static [&'static str],
    },
    /// A file could not be read.
    #[error("{}: cannot read it: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file is larger than [`limits`](crate::scene::limits) allow.
    #[error("{}: {bytes} bytes, at most {limit} are supported", path.display())]
    FileTooLarge {
        /// The file.
        path: PathBuf,
        /// Its size in bytes.
        bytes: u64,
        /// The limit in bytes.
        limit: u64,
    },
    /// A scene file is not TOML of version 1 (the message names line and key).
    #[error("{}: {message}", path.display())]
    SceneFile {
        /// The scene file.
        path: PathBuf,
        /// The parser's message with line, column and key.
        message: String,
    },
    /// A value of a scene file is out of its range.
    #[error("{}: `{key}`: {problem}", path.display())]
    SceneValue {
        /// The scene file.
        path: PathBuf,
        /// The key, with the index of its table.
        key: String,
        /// Problem with the value.
        problem: String,
    },
    /// The JSON text of a file is not glTF 2.0.
    #[error("{}: not a glTF 2.0 file: {source}", path.display())]
    NotGltf {
        /// The file.
        path: PathBuf,
        /// Error of the parser, with line and column.
        source: serde_json::Error,
    },
    /// A glTF file contradicts itself or the specification.
    #[error("{}: {place}: {problem}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// The place, as a JSON path such as `accessors[3]`.
        place: String,
        /// Problem at that place.
        problem: GltfProblem,
    },
    /// A texture that a mask or a normal map needs cannot be decoded.
    #[error("{}: {place}: cannot decode the image: {source}", path.display())]
    Image {
        /// The glTF file.
        path: PathBuf,
        /// The image, as a JSON path.
        place: String,
        /// Error of the decoder.
        source: Box<image::ImageError>,
    },
    /// The scene file asks for an animation that the model does not have.
    #[error("{}: no animation `{requested}`; it has: {}", path.display(), available.join(", "))]
    UnknownAnimation {
        /// The glTF file.
        path: PathBuf,
        /// The requested name or index.
        requested: String,
        /// Names of the animations in the file, or indices of unnamed ones.
        available: Vec<String>,
    },
    /// The scene has no triangle with a surface.
    #[error("{origin}: no triangles in the scene: there is nothing to shade")]
    NoTriangles {
        /// The scene as it was named.
        origin: String,
    },
    /// An instance is so far from the origin or so large that single precision fails.
    #[error("{origin}: instance `{instance}` reaches beyond {limit_m:e} m: scale the scene to metres")]
    TooFar {
        /// The scene as it was named.
        origin: String,
        /// Name of the instance.
        instance: String,
        /// The limit in metres.
        limit_m: f64,
    },
    /// The assembled scene is larger than [`limits`](crate::scene::limits) allow.
    #[error("{origin}: {count} {what}, at most {limit} are supported")]
    TooMany {
        /// The scene as it was named.
        origin: String,
        /// Kind of the things that are too many.
        what: &'static str,
        /// Number found.
        count: usize,
        /// Number allowed.
        limit: usize,
    },
}

/// Problem at one place of a glTF file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GltfProblem {
    /// Something required is missing.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A value is not defined by the specification.
    #[error("{0} has a value that glTF 2.0 does not define")]
    Invalid(&'static str),
    /// An index is past the end of its list.
    #[error("{what} {index} does not exist: there are {count}, counted from 0")]
    OutOfRange {
        /// Kind of the indexed things.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of things in the list.
        count: usize,
    },
    /// A range goes past the end of a buffer or view.
    #[error("bytes {start}..{end} are beyond the {available} bytes available")]
    OutOfBytes {
        /// First byte.
        start: u64,
        /// One past the last byte.
        end: u64,
        /// Bytes present.
        available: u64,
    },
    /// An accessor has a type that does not fit its use.
    #[error("expected {expected}, found {found}")]
    WrongType {
        /// Types that fit.
        expected: &'static str,
        /// Type found.
        found: String,
    },
    /// Two lists that belong together differ in length.
    #[error("{what}: expected {expected}, found {found}")]
    CountMismatch {
        /// Kind of the counted things.
        what: &'static str,
        /// Expected count.
        expected: usize,
        /// Count found.
        found: usize,
    },
    /// A NaN or an infinity.
    #[error("element {element} is not a finite number")]
    NonFinite {
        /// Index of the element in the accessor or array.
        element: usize,
    },
    /// A magnitude is too large: single precision cannot hold its square.
    #[error("a magnitude of {value:e} is beyond the limit of {limit:e}")]
    TooFar {
        /// The value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// The times of keys decrease.
    #[error("key {element} is earlier than the key before it")]
    TimeGoesBack {
        /// Index of the key.
        element: usize,
    },
    /// A node is its own ancestor.
    #[error("the node is its own ancestor")]
    Cycle,
    /// A node has two parents.
    #[error("the node has two parents")]
    TwoParents,
    /// The file is of a version other than 2.0.
    #[error(
        "this is glTF {}, and only glTF 2.0 is read: `npx gltf-pipeline -i in.gltf -o out.glb` converts glTF 1.0",
        .0.escape_debug()
    )]
    Version(String),
    /// The text is not UTF-8.
    #[error("the text is UTF-16: save it as UTF-8")]
    Utf16,
    /// The file requires an extension that is not known here.
    #[error("{} is required and not supported: export the file without it", .0.escape_debug())]
    Extension(String),
    /// A mask is an image in a format that is not decoded here.
    #[error(
        "its mask is an image of {0}, which is not decoded: `npx @gltf-transform/cli {command} in.glb out.glb` converts it",
        command = if *.0 == "KHR_texture_basisu" { "ktxdecompress" } else { "png" }
    )]
    ImageFormat(&'static str),
    /// Compressed data cannot be unpacked.
    #[error("cannot unpack the data of {what}: {problem}: export the file again")]
    Compressed {
        /// The extension.
        what: &'static str,
        /// Problem with the data.
        problem: String,
    },
    /// A URI cannot be resolved.
    #[error("cannot resolve the URI: {0}")]
    Uri(String),
    /// A count is larger than [`limits`](crate::scene::limits) allow.
    #[error("{what}: {count}, at most {limit} are supported")]
    TooMany {
        /// Kind of the things that are too many.
        what: &'static str,
        /// Number found.
        count: u64,
        /// The limit.
        limit: u64,
    },
}
