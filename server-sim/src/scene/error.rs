//! What can go wrong while a scene is read: each error names the file, the place in it and what to do.

use std::path::PathBuf;

/// Why a scene could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The argument is no built-in scene and has no known file extension.
    #[error("`{name}` is neither a built-in scene ({}) nor a .toml, .gltf or .glb file", builtin.join(", "))]
    UnknownScene {
        /// The name as given.
        name: String,
        /// The names that would have worked.
        builtin: &'static [&'static str],
    },
    /// A file could not be read.
    #[error("{}: cannot read it: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file is larger than [`limits`](crate::scene::limits) allow.
    #[error("{}: {bytes} bytes, at most {limit} are read", path.display())]
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
        /// What is wrong with it.
        problem: String,
    },
    /// A file is not glTF 2.0.
    #[error("{}: not a glTF 2.0 file: {source}", path.display())]
    NotGltf {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        source: Box<gltf::Error>,
    },
    /// A glTF file contradicts itself or the specification.
    #[error("{}: {place}: {problem}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// The place, as a JSON path such as `accessors[3]`.
        place: String,
        /// What is wrong there.
        problem: GltfProblem,
    },
    /// A texture that a mask or a normal map needs cannot be decoded.
    #[error("{}: {place}: cannot decode the image: {source}", path.display())]
    Image {
        /// The glTF file.
        path: PathBuf,
        /// The image, as a JSON path.
        place: String,
        /// What the decoder said.
        source: Box<image::ImageError>,
    },
    /// The scene file asks for an animation that the model does not have.
    #[error("{}: no animation `{requested}`; it has: {}", path.display(), available.join(", "))]
    UnknownAnimation {
        /// The glTF file.
        path: PathBuf,
        /// The name or index that was asked for.
        requested: String,
        /// The names (or indices where unnamed) of its animations.
        available: Vec<String>,
    },
    /// Nothing with a surface is in the scene.
    #[error("{origin}: no triangles in the scene: there is nothing to shade")]
    NoTriangles {
        /// The scene as it was named.
        origin: String,
    },
    /// An instance is so far out or so large that single precision fails.
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
    #[error("{origin}: {count} {what}, at most {limit} are taken")]
    TooMany {
        /// The scene as it was named.
        origin: String,
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many are allowed.
        limit: usize,
    },
}

/// What is wrong at one place of a glTF file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GltfProblem {
    /// Something that has to be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A value that the specification does not know.
    #[error("{0} has a value that glTF 2.0 does not know")]
    Invalid(&'static str),
    /// An index points past the end.
    #[error("{what} {index} does not exist, there are {count}")]
    OutOfRange {
        /// What the index selects.
        what: &'static str,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// Bytes past the end of a buffer or view are asked for.
    #[error("bytes {start}..{end} are outside the {available} that there are")]
    OutOfBytes {
        /// First byte.
        start: u64,
        /// One past the last byte.
        end: u64,
        /// Bytes present.
        available: u64,
    },
    /// An accessor has another type than its use needs.
    #[error("expected {expected}, found {found}")]
    WrongType {
        /// Types that would do.
        expected: &'static str,
        /// Type found.
        found: String,
    },
    /// Two things that belong together differ in length.
    #[error("{what}: expected {expected}, found {found}")]
    CountMismatch {
        /// What is counted.
        what: &'static str,
        /// Expected count.
        expected: usize,
        /// Count found.
        found: usize,
    },
    /// A NaN or an infinity.
    #[error("element {element} is not a finite number")]
    NonFinite {
        /// Which element of the accessor or array.
        element: usize,
    },
    /// A magnitude beyond what single precision can square.
    #[error("a magnitude of {value:e} is beyond the limit of {limit:e}")]
    TooFar {
        /// The value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// Key times that go back.
    #[error("key {element} is earlier than the key before it")]
    TimeGoesBack {
        /// Which key.
        element: usize,
    },
    /// A node is its own ancestor.
    #[error("the node is its own ancestor")]
    Cycle,
    /// A node has two parents.
    #[error("the node has two parents")]
    TwoParents,
    /// A feature that this reader does not have.
    #[error("{0} is not supported")]
    Unsupported(String),
    /// A URI that cannot be resolved.
    #[error("cannot resolve the URI: {0}")]
    Uri(String),
    /// More than [`limits`](crate::scene::limits) allow.
    #[error("{what}: {count}, at most {limit} are read")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: u64,
        /// The limit.
        limit: u64,
    },
}
