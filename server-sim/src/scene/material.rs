//! The properties of a material that affect ambient occlusion: sides, masks and normal maps.

use glam::{Vec2, Vec3};

use crate::scene::texture::Texture;

/// Alpha test that decides where a masked surface exists.
#[derive(Debug, Clone, PartialEq)]
pub struct AlphaMask {
    pub(crate) texture: Option<Texture<1>>,
    pub(crate) factor: f32,
    pub(crate) cutoff: f32,
}

impl AlphaMask {
    /// Returns the alpha channel of the base colour texture, or `None` if the factor alone decides.
    #[must_use]
    pub fn texture(&self) -> Option<&Texture<1>> {
        self.texture.as_ref()
    }

    /// Returns the factor of the texture's alpha.
    #[must_use]
    pub fn factor(&self) -> f32 {
        self.factor
    }

    /// Returns the smallest alpha at which the surface exists.
    #[must_use]
    pub fn cutoff(&self) -> f32 {
        self.cutoff
    }
}

/// A tangent-space normal map.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalMap {
    pub(crate) texture: Texture<3>,
    pub(crate) scale: f32,
}

impl NormalMap {
    /// Returns the map. Red is the component along the tangent, green along the bitangent, blue along the normal.
    #[must_use]
    pub fn texture(&self) -> &Texture<3> {
        &self.texture
    }

    /// Returns the factor of the first two components.
    #[must_use]
    pub fn scale(&self) -> f32 {
        self.scale
    }
}

/// A material. Vertex colours are ignored: their alpha is not part of a mask.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Material {
    pub(crate) name: String,
    pub(crate) double_sided: bool,
    pub(crate) mask: Option<AlphaMask>,
    pub(crate) normal_map: Option<NormalMap>,
}

impl Material {
    /// Returns the name from the file; it may be empty.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether the back of its triangles is a surface as well. Occlusion is two-sided for every material.
    #[must_use]
    pub fn double_sided(&self) -> bool {
        self.double_sided
    }

    /// Returns the mask, if the surface has holes.
    #[must_use]
    pub fn mask(&self) -> Option<&AlphaMask> {
        self.mask.as_ref()
    }

    /// Returns the normal map, if there is one.
    #[must_use]
    pub fn normal_map(&self) -> Option<&NormalMap> {
        self.normal_map.as_ref()
    }

    /// Returns whether the surface exists at these coordinates of the mask ([`Mesh::uvs`](crate::scene::Mesh::uvs)).
    #[must_use]
    pub fn is_opaque_at(&self, uv: Vec2) -> bool {
        self.mask.as_ref().is_none_or(|mask| {
            let alpha = mask.texture.as_ref().map_or(1.0, |texture| texture.sample(uv)[0]);
            alpha * mask.factor >= mask.cutoff
        })
    }

    /// Returns the unit normal in tangent space at these coordinates of the normal map
    /// ([`Mesh::normal_uvs`](crate::scene::Mesh::normal_uvs)), or +Z without a map.
    #[must_use]
    pub fn normal_at(&self, uv: Vec2) -> Vec3 {
        self.normal_map.as_ref().map_or(Vec3::Z, |map| {
            let [x, y, z] = map.texture.sample(uv).map(|v| v * 2.0 - 1.0);
            Vec3::new(x * map.scale, y * map.scale, z).try_normalize().unwrap_or(Vec3::Z)
        })
    }

    /// Returns whether the mask removes the whole surface.
    pub(crate) fn all_masked(&self) -> bool {
        self.mask.as_ref().is_some_and(|mask| {
            let alpha =
                mask.texture.as_ref().map_or(255, |t| t.texels().iter().map(|a| a[0]).max().unwrap_or(0));
            f32::from(alpha) / 255.0 * mask.factor < mask.cutoff
        })
    }
}
