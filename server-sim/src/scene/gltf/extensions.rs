//! What the reader does with each extension.

use super::schema::Root;

/// Extensions that are applied, or whose effect on surfaces is nothing. All `KHR_materials_*` belong here, too.
const KNOWN: [&str; 31] = [
    // Applied: geometry, visibility, masks and animation.
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
    // Images in formats that are not decoded. Whoever reads such a texture says so.
    "EXT_texture_avif",
    "KHR_texture_basisu",
    "MSFT_texture_dds",
    // Light, cameras, sound, looks and behaviour.
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "KHR_audio_emitter",
    "KHR_environment_map",
    "KHR_lights_punctual",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    // Notes about the content.
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "FB_ngon_encoding",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];

/// Returns whether a file with this extension is read as it is meant.
fn is_known(name: &str) -> bool {
    KNOWN.contains(&name) || name.starts_with("KHR_materials_")
}

/// Returns the first extension that the file requires and this reader does not know.
pub(super) fn unknown_required(root: &Root) -> Option<&str> {
    root.extensions_required.iter().map(String::as_str).find(|name| !is_known(name))
}

/// Returns the extensions that the file uses and this reader does not know.
pub(super) fn unknown_used(root: &Root) -> impl Iterator<Item = &str> {
    root.extensions_used.iter().map(String::as_str).filter(|name| !is_known(name))
}
