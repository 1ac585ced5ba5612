//! Materials of a glTF file: sides, masks and normal maps. Other images are not opened.

use std::sync::Arc;

use gltf::json::material::{AlphaMode, Material as JsonMaterial};
use gltf::json::texture::{MagFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{self, Index};
use image::ImageReader;

use super::document::GltfDocument;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::material::{AlphaMask, Material, NormalMap};
use crate::scene::model::Model;
use crate::scene::texture::{Texture, Wrap};

/// A material of the model, and the sets of texture coordinates for its mask and normal map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaterialUse {
    pub(super) material: usize,
    pub(super) mask_set: Option<u32>,
    pub(super) normal_set: Option<u32>,
}

/// Adds the file's materials to the model. The last entry is the default material.
pub(super) fn read(
    document: &GltfDocument,
    model: &mut Model,
    hasher: &mut blake3::Hasher,
) -> Result<Vec<MaterialUse>, SceneError> {
    let mut out = Vec::new();
    for (i, material) in document.root.materials.iter().enumerate() {
        out.push(read_one(document, material, &format!("materials[{i}]"), model, hasher)?);
    }
    let plain = model.add_material(Material::default());
    out.push(MaterialUse { material: plain, mask_set: None, normal_set: None });
    Ok(out)
}

fn read_one(
    document: &GltfDocument,
    json: &JsonMaterial,
    place: &str,
    model: &mut Model,
    hasher: &mut blake3::Hasher,
) -> Result<MaterialUse, SceneError> {
    let Checked::Valid(mode) = json.alpha_mode else {
        return Err(document.error(place, GltfProblem::Invalid("alphaMode")));
    };
    model.report.blended_materials += usize::from(mode == AlphaMode::Blend);
    let colour = &json.pbr_metallic_roughness;
    let (mut mask, mut mask_set) = (None, None);
    if mode == AlphaMode::Mask {
        let (factor, cutoff) =
            (colour.base_color_factor.0[3], json.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0));
        super::nodes::check(&[factor, cutoff]).map_err(|problem| document.error(place, problem))?;
        let mut texture = None;
        if let Some(info) = &colour.base_color_texture {
            mask_set = Some(info.tex_coord);
            texture = Some(load_texture(document, info.index, place, hasher, |rgba| [rgba[3]])?);
        }
        mask = Some(AlphaMask { texture, factor, cutoff });
    }
    let (mut normal_map, mut normal_set) = (None, None);
    if let Some(normal) = &json.normal_texture {
        super::nodes::check(&[normal.scale]).map_err(|problem| document.error(place, problem))?;
        normal_set = Some(normal.tex_coord);
        let texture = load_texture(document, normal.index, place, hasher, |[r, g, b, _]| [r, g, b])?;
        normal_map = Some(NormalMap { texture, scale: normal.scale });
    }
    let material = Material {
        name: json.name.clone().unwrap_or_default(),
        double_sided: json.double_sided,
        mask,
        normal_map,
    };
    Ok(MaterialUse { material: model.add_material(material), mask_set, normal_set })
}

/// Reads and decodes an image, and keeps the channels that `pick` selects.
fn load_texture<const N: usize>(
    document: &GltfDocument,
    index: Index<json::Texture>,
    place: &str,
    hasher: &mut blake3::Hasher,
    pick: fn([u8; 4]) -> [u8; N],
) -> Result<Texture<N>, SceneError> {
    let texture = document.get("texture", index, place)?;
    let here = format!("textures[{}]", index.value());
    let sampler = texture.sampler.map(|sampler| document.get("sampler", sampler, &here)).transpose()?;
    let (wrap, nearest) = sampling(document, sampler, &here)?;
    let image = document.get("image", texture.source, &here)?;
    let here = format!("images[{}]", texture.source.value());
    let bytes = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => document.resolve(uri, &here, hasher)?,
        (None, Some(view)) => document.view(view, &here)?.0.to_vec(),
        (None, None) => return Err(document.error(here, GltfProblem::Missing("uri or bufferView"))),
    };
    let fail = |source| SceneError::Image {
        path: document.path.clone(),
        place: here.clone(),
        source: Box::new(source),
    };
    let reader =
        || ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format().map_err(|e| fail(e.into()));
    let (width, height) = reader()?.into_dimensions().map_err(fail)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > limits::MAX_TEXTURE_PIXELS {
        let problem =
            GltfProblem::TooMany { what: "pixels", count: pixels, limit: limits::MAX_TEXTURE_PIXELS };
        return Err(document.error(here, problem));
    }
    let decoded = reader()?.decode().map_err(fail)?.into_rgba8();
    let texels: Arc<[[u8; N]]> = decoded.pixels().map(|pixel| pick(pixel.0)).collect();
    Texture::new([width, height], wrap, nearest, texels)
        .ok_or_else(|| document.error(here.as_str(), GltfProblem::Missing("a pixel")))
}

/// Returns the wrap modes, and whether sampling takes the nearest texel.
fn sampling(
    document: &GltfDocument,
    sampler: Option<&Sampler>,
    place: &str,
) -> Result<([Wrap; 2], bool), SceneError> {
    let Some(sampler) = sampler else { return Ok(([Wrap::Repeat; 2], false)) };
    let wrap = |mode: &Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
        Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
        Checked::Invalid => Err(document.error(place, GltfProblem::Invalid("wrapping mode"))),
    };
    let nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
    Ok(([wrap(&sampler.wrap_s)?, wrap(&sampler.wrap_t)?], nearest))
}
