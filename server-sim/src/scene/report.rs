//! Counts of what was dropped or repaired while a scene was loaded.

/// Counts of the content of a scene file that was dropped or changed during loading.
///
/// All counts are zero for a clean file. None of them is an error: each has a documented, deterministic result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SceneReport {
    /// Dropped triangles without area. If vertices move, only triangles that name a vertex twice are dropped.
    pub degenerate_triangles: usize,
    /// Primitives of points or lines, which have no surface.
    pub point_or_line_primitives: usize,
    /// Primitives without any remaining triangle.
    pub empty_primitives: usize,
    /// Primitives that their mask removes completely.
    pub masked_out_primitives: usize,
    /// Primitives without normals. They get flat normals, as glTF 2.0 (section 3.7.2.1) requires.
    pub flat_normals: usize,
    /// Vertex normals without length, replaced by the area-weighted normal of their triangles.
    pub replaced_normals: usize,
    /// Primitives with a normal map but without tangents. The tangents were derived from the texture coordinates.
    pub generated_tangents: usize,
    /// Masks or normal maps that are ignored because the primitive lacks their texture coordinates.
    pub missing_texcoords: usize,
    /// Skinned vertices whose weights sum to zero. They follow their first joint.
    pub unweighted_vertices: usize,
    /// Instances that never have an area because two axes are always scaled to zero.
    pub collapsed_instances: usize,
    /// Animation channels that move nothing visible.
    pub idle_channels: usize,
    /// Animation channels replaced by a later channel of the same node and property.
    pub overruled_channels: usize,
    /// Ignored animation channels on nodes with a matrix, which glTF 2.0 forbids.
    pub matrix_channels: usize,
    /// Materials with `BLEND` transparency, which count as opaque.
    pub blended_materials: usize,
}
