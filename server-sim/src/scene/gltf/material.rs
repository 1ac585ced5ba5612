//! Materials of a glTF file: sides, masks and normal maps.

use std::collections::BTreeSet;

use glam::{Affine2, Mat2, Vec2};

use super::document::GltfDocument;
use super::nodes::check;
use super::schema::{Material as JsonMaterial, Primitive, TextureInfo};
use super::texture;
use super::triangles::Mode;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::material::{AlphaMask, Material, NormalMap};
use crate::scene::model::Model;

/// Texture coordinates of a mask or a normal map.
#[derive(Debug, Clone, Copy)]
pub(super) struct TexCoords {
    /// Number of the set of texture coordinates.
    pub(super) set: u32,
    /// Where the material puts the texture (`KHR_texture_transform`).
    pub(super) transform: Option<Affine2>,
}

/// A material of the model, and the texture coordinates of its mask and normal map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaterialUse {
    pub(super) material: usize,
    pub(super) mask: Option<TexCoords>,
    pub(super) normal: Option<TexCoords>,
}

/// The file's materials in the model.
pub(super) struct Materials {
    /// One for each material of the file; `None` if no surface has it.
    used: Vec<Option<MaterialUse>>,
    /// The material of primitives without one.
    plain: MaterialUse,
}

impl Materials {
    /// Returns the material of a primitive.
    pub(super) fn of(
        &self,
        document: &GltfDocument,
        primitive: &Primitive,
        place: &str,
    ) -> Result<MaterialUse, SceneError> {
        let Some(index) = primitive.material else { return Ok(self.plain) };
        document.get("material", &self.used, index, place).map(|known| known.unwrap_or(self.plain))
    }
}

/// Adds the materials of the file's surfaces to the model. The images of others are never opened.
pub(super) fn read(
    document: &GltfDocument,
    model: &mut Model,
    hasher: &mut blake3::Hasher,
) -> Result<Materials, SceneError> {
    let primitives = document.root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let surfaces = primitives.filter(|p| !matches!(Mode::new(p.mode), Some(Mode::Points | Mode::Lines)));
    let wanted: BTreeSet<usize> = surfaces.filter_map(|primitive| primitive.material).collect();
    let mut used = Vec::new();
    for (i, material) in document.root.materials.iter().enumerate() {
        let place = format!("materials[{i}]");
        let read = || read_one(document, material, &place, model, hasher);
        used.push(wanted.contains(&i).then(read).transpose()?);
    }
    let plain = model.add_material(Material::default());
    Ok(Materials { used, plain: MaterialUse { material: plain, mask: None, normal: None } })
}

fn read_one(
    document: &GltfDocument,
    json: &JsonMaterial,
    place: &str,
    model: &mut Model,
    hasher: &mut blake3::Hasher,
) -> Result<MaterialUse, SceneError> {
    let mut use_of = MaterialUse { material: 0, mask: None, normal: None };
    let mut mask = None;
    match json.alpha_mode.as_deref().unwrap_or("OPAQUE") {
        "OPAQUE" => {}
        "BLEND" => model.report.blended_materials += 1,
        "MASK" => {
            let (own, coordinates) = read_mask(document, json, place, hasher)?;
            model.report.masks_without_image += usize::from(coordinates.is_some() && own.texture.is_none());
            (mask, use_of.mask) = (Some(own), coordinates);
        }
        _ => return Err(document.error(place, GltfProblem::Invalid("alphaMode"))),
    }
    let mut normal_map = None;
    if let Some(info) = &json.normal_texture {
        let scale = info.scale.unwrap_or(1.0);
        check(&[scale]).map_err(|problem| document.error(place, problem))?;
        match texture::read(document, info.index, place, hasher, |[r, g, b, _]| [r, g, b])? {
            texture::Reading::Texels(texture) => {
                use_of.normal = Some(coordinates(document, info, place)?);
                normal_map = Some(NormalMap { texture, scale });
            }
            texture::Reading::Unreadable(_) | texture::Reading::Nothing => {
                model.report.unread_normal_maps += 1;
            }
        }
    }
    let name = json.name.clone().unwrap_or_default();
    let material = Material { name, double_sided: json.double_sided, mask, normal_map };
    Ok(MaterialUse { material: model.add_material(material), ..use_of })
}

/// Reads what decides where a masked surface exists, with the coordinates of its texture.
fn read_mask(
    document: &GltfDocument,
    json: &JsonMaterial,
    place: &str,
    hasher: &mut blake3::Hasher,
) -> Result<(AlphaMask, Option<TexCoords>), SceneError> {
    // A material may have its base colour twice; the extension is what a reader that knows it uses.
    let (colour, info) = match &json.extensions.specular_glossiness {
        Some(own) => (own.diffuse_factor, &own.diffuse_texture),
        None => {
            (json.pbr_metallic_roughness.base_color_factor, &json.pbr_metallic_roughness.base_color_texture)
        }
    };
    let (factor, cutoff) = (colour.map_or(1.0, |colour| colour[3]), json.alpha_cutoff.unwrap_or(0.5));
    check(&[factor, cutoff]).map_err(|problem| document.error(place, problem))?;
    let Some(info) = info else { return Ok((AlphaMask { texture: None, factor, cutoff }, None)) };
    let texture = match texture::read(document, info.index, place, hasher, |rgba| [rgba[3]])? {
        texture::Reading::Texels(texture) => Some(texture),
        texture::Reading::Nothing => None,
        // Without it, the surface would be whole where it has holes.
        texture::Reading::Unreadable(format) => {
            return Err(document.error(place, GltfProblem::ImageFormat(format)));
        }
    };
    Ok((AlphaMask { texture, factor, cutoff }, Some(coordinates(document, info, place)?)))
}

fn coordinates(document: &GltfDocument, info: &TextureInfo, place: &str) -> Result<TexCoords, SceneError> {
    let Some(json) = &info.extensions.transform else {
        return Ok(TexCoords { set: info.tex_coord, transform: None });
    };
    let (offset, scale) = (json.offset.unwrap_or([0.0; 2]), json.scale.unwrap_or([1.0; 2]));
    let turn = json.rotation.unwrap_or(0.0);
    check(&[offset[0], offset[1], scale[0], scale[1], turn])
        .map_err(|problem| document.error(format!("{place}: KHR_texture_transform"), problem))?;
    // Counter-clockwise in a picture whose v grows downwards.
    let (sin, cos) = (libm::sinf(turn), libm::cosf(turn));
    let turned = Mat2::from_cols(Vec2::new(cos, -sin) * scale[0], Vec2::new(sin, cos) * scale[1]);
    let transform = Affine2::from_mat2_translation(turned, Vec2::from_array(offset));
    Ok(TexCoords { set: json.tex_coord.unwrap_or(info.tex_coord), transform: Some(transform) })
}
