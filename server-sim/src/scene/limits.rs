//! Limits of a scene. A larger scene is rejected before memory is allocated for it.

/// Largest size in bytes of one file that a scene refers to.
pub const MAX_FILE_BYTES: u64 = 1 << 31;
/// Largest JSON text in bytes that may repeat keys or write integers with a decimal point. It takes more memory to read.
pub const MAX_UNUSUAL_JSON_BYTES: usize = 1 << 26;
/// Most elements of one glTF accessor.
pub const MAX_ELEMENTS: u64 = 1 << 25;
/// Most numbers that are read from the accessors of one glTF file. An accessor counts for each of its uses.
pub const MAX_NUMBERS: u64 = 1 << 30;
/// Most nodes of one glTF file, and of all parts of a scene together.
pub const MAX_NODES: usize = 1 << 16;
/// Most instances (one per node and primitive) of a scene.
pub const MAX_INSTANCES: usize = 65_536;
/// Most triangles of all instances of a scene together.
pub const MAX_TRIANGLES: usize = 1 << 27;
/// Most pixels of one texture.
pub const MAX_TEXTURE_PIXELS: u64 = 1 << 26;
/// Most pixels of the textures of one glTF file. A texture counts for each of its uses.
pub const MAX_PIXELS: u64 = 1 << 30;
/// Most animation channels of a scene. One of a mesh's weights counts for each node that shows the mesh.
pub const MAX_CHANNELS: usize = 1 << 22;
/// Most parts of a scene file.
pub const MAX_PARTS: usize = 4_096;
/// Largest magnitude of a position, translation or scale, in metres. Its cube is still a finite `f32`.
pub const MAX_MAGNITUDE: f64 = 1e9;
/// Most vertices of all meshes of one glTF file together.
pub const MAX_VERTICES: usize = 1 << 26;
/// Most joints of one skin.
pub const MAX_JOINTS: usize = 1 << 12;
