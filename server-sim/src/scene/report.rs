//! What was left out or repaired while a scene was loaded: defined results for odd input, counted.

/// Counts of everything that a scene file held and the scene does not, or holds otherwise.
///
/// All zero for a clean file. Nothing here is an error: each count has a documented, deterministic result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SceneReport {
    /// Triangles without area (or, where vertices move, with a vertex named twice) that were dropped.
    pub degenerate_triangles: usize,
    /// Primitives made of points or lines, which have no surface.
    pub point_or_line_primitives: usize,
    /// Primitives without any triangle left.
    pub empty_primitives: usize,
    /// Primitives whose mask lets nothing through, everywhere.
    pub masked_out_primitives: usize,
    /// Primitives without normals: they were given flat ones, as glTF 2.0 (section 3.7.2.1) demands.
    pub flat_normals: usize,
    /// Vertex normals without length, replaced by the area-weighted normal of their triangles.
    pub replaced_normals: usize,
    /// Primitives with a normal map but without tangents: tangents were derived from the texture coordinates.
    pub generated_tangents: usize,
    /// Masks or normal maps on primitives without the texture coordinates that they need: not applied.
    pub missing_texcoords: usize,
    /// Skinned vertices whose weights add up to nothing: bound to their first joint.
    pub unweighted_vertices: usize,
    /// Instances whose transform has no area left (two axes scaled to nothing, for ever).
    pub collapsed_instances: usize,
    /// Animation channels that move nothing visible.
    pub idle_channels: usize,
    /// Animation channels overruled by a later channel of the same node and property.
    pub overruled_channels: usize,
    /// Animation channels on nodes given as a matrix, which glTF 2.0 forbids: ignored.
    pub matrix_channels: usize,
    /// Materials with `BLEND` transparency: taken as opaque.
    pub blended_materials: usize,
}
