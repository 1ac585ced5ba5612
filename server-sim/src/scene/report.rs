//! Counts of what was left out or read in another way while a scene was loaded.

use std::collections::BTreeSet;

/// Counts of the content of a scene file that was left out, read in another way or derived during loading.
///
/// All counts are zero for a clean file. None of them is an error: each has a documented, deterministic result.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SceneReport {
    /// Dropped triangles without area. If vertices move, only triangles that name a vertex twice are dropped.
    pub degenerate_triangles: usize,
    /// Triangles whose vertex normals all point to the other side of their face. Both are kept as modelled.
    pub opposed_triangles: usize,
    /// Primitives of points, which have no surface.
    pub point_primitives: usize,
    /// Primitives of lines, which have no surface.
    pub line_primitives: usize,
    /// Primitives without positions, which glTF 2.0 (section 3.7.2.1) says to skip.
    pub primitives_without_positions: usize,
    /// Primitives whose last corners do not form a whole triangle. Those corners are dropped.
    pub incomplete_primitives: usize,
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
    /// Materials whose mask has a texture without an image. Their factor alone decides.
    pub masks_without_image: usize,
    /// Materials whose normal map has no image, or only one that is not decoded. The vertex normals remain.
    pub unread_normal_maps: usize,
    /// Materials with `BLEND` transparency, which count as opaque.
    pub blended_materials: usize,
    /// Skinned vertices whose weights sum to zero. They follow their first joint.
    pub unweighted_vertices: usize,
    /// Skinned nodes with `EXT_mesh_gpu_instancing`. They appear once, as joints place them.
    pub skinned_instancing: usize,
    /// Instances that never have an area because two axes are always scaled to zero.
    pub collapsed_instances: usize,
    /// Instances that are hidden at all times (`KHR_node_visibility`).
    pub hidden_instances: usize,
    /// Animation channels that move nothing visible.
    pub idle_channels: usize,
    /// Animation channels without a node, which glTF 2.0 (section 3.11) says to ignore.
    pub channels_without_node: usize,
    /// Animation channels that drive something else than nodes and weights, such as colours.
    pub other_channels: usize,
    /// Animation channels without a key.
    pub empty_channels: usize,
    /// Animation channels replaced by a later channel of the same node and property.
    pub overruled_channels: usize,
    /// Ignored animation channels on nodes with a matrix, which glTF 2.0 forbids.
    pub matrix_channels: usize,
    /// Extensions that the file uses without requiring them, and that this reader does not know.
    pub unknown_extensions: BTreeSet<String>,
}

/// A count with its words for one and for several.
type Entry = (usize, &'static str, &'static str);

impl SceneReport {
    /// Returns the report for people, one line for each kind of change. A clean file has none.
    ///
    /// ```
    /// let scene = psao_server::scene::Scene::load("colonnade")?;
    /// assert!(scene.report().lines().is_empty());
    /// # Ok::<(), psao_server::scene::SceneError>(())
    /// ```
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let kinds: [(&str, &[Entry]); 3] = [
            ("left out", &self.left_out()),
            ("read in another way", &self.read_in_another_way()),
            ("derived", &self.derived()),
        ];
        let mut lines: Vec<String> =
            kinds.into_iter().filter_map(|(kind, entries)| line(kind, entries)).collect();
        if !self.unknown_extensions.is_empty() {
            let names: Vec<String> =
                self.unknown_extensions.iter().map(|name| name.escape_debug().to_string()).collect();
            lines
                .push(format!("extensions without effect here, as they are not known: {}", names.join(", ")));
        }
        lines
    }

    fn left_out(&self) -> [Entry; 17] {
        [
            (self.point_primitives, "primitive of points", "primitives of points"),
            (self.line_primitives, "primitive of lines", "primitives of lines"),
            (
                self.primitives_without_positions,
                "primitive without positions",
                "primitives without positions",
            ),
            (
                self.incomplete_primitives,
                "incomplete last triangle of a primitive",
                "incomplete last triangles of primitives",
            ),
            (self.empty_primitives, "primitive without triangles", "primitives without triangles"),
            (
                self.masked_out_primitives,
                "primitive that its mask removes",
                "primitives that their masks remove",
            ),
            (self.degenerate_triangles, "triangle without area", "triangles without area"),
            (
                self.missing_texcoords,
                "mask or normal map without texture coordinates",
                "masks or normal maps without texture coordinates",
            ),
            (self.masks_without_image, "texture of a mask without image", "textures of masks without image"),
            (
                self.unread_normal_maps,
                "normal map that cannot be decoded",
                "normal maps that cannot be decoded",
            ),
            (self.collapsed_instances, "instance scaled to nothing", "instances scaled to nothing"),
            (self.hidden_instances, "hidden instance", "hidden instances"),
            (
                self.channels_without_node,
                "animation channel without a node",
                "animation channels without a node",
            ),
            (
                self.other_channels,
                "animation channel that moves no surface",
                "animation channels that move no surface",
            ),
            (
                self.idle_channels,
                "animation channel of nothing visible",
                "animation channels of nothing visible",
            ),
            (self.empty_channels, "animation channel without keys", "animation channels without keys"),
            (
                self.matrix_channels,
                "animation channel of a node with a matrix",
                "animation channels of nodes with a matrix",
            ),
        ]
    }

    fn read_in_another_way(&self) -> [Entry; 6] {
        [
            (self.blended_materials, "material with BLEND as opaque", "materials with BLEND as opaque"),
            (
                self.overruled_channels,
                "animation channel overruled by a later one",
                "animation channels overruled by later ones",
            ),
            (
                self.opposed_triangles,
                "triangle with normals against its face (kept)",
                "triangles with normals against their faces (kept)",
            ),
            (
                self.unweighted_vertices,
                "vertex without weights at its first joint",
                "vertices without weights at their first joints",
            ),
            (self.skinned_instancing, "instanced skin shown once", "instanced skins shown once"),
            (self.replaced_normals, "normal without length replaced", "normals without length replaced"),
        ]
    }

    fn derived(&self) -> [Entry; 2] {
        [
            (self.flat_normals, "primitive's flat normals", "primitives' flat normals"),
            (self.generated_tangents, "primitive's tangents", "primitives' tangents"),
        ]
    }
}

fn line(kind: &str, entries: &[Entry]) -> Option<String> {
    let counted = entries.iter().filter(|entry| entry.0 > 0);
    let words =
        |(count, one, several): &Entry| format!("{count} {}", if *count == 1 { one } else { several });
    let words: Vec<String> = counted.map(words).collect();
    (!words.is_empty()).then(|| format!("{kind}: {}", words.join(", ")))
}
