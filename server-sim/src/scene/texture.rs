//! Textures for masks and normal maps, with the sampling rules of glTF 2.0.

use std::sync::Arc;

use glam::Vec2;

/// Treatment of texture coordinates outside 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The edge continues without end.
    Clamp,
    /// Copies follow each other, every other one mirrored.
    Mirror,
    /// Copies follow each other.
    #[default]
    Repeat,
}

impl Wrap {
    /// Returns the index of the texel at an integer position, for `size` texels.
    fn texel(self, position: i64, size: u32) -> usize {
        let size = i64::from(size);
        let inside = match self {
            Self::Clamp => position.clamp(0, size - 1),
            Self::Repeat => position.rem_euclid(size),
            Self::Mirror => {
                let there = position.rem_euclid(2 * size);
                there.min(2 * size - 1 - there)
            }
        };
        inside as usize
    }
}

/// A texture of `N` channels of 8 bits, stored row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture<const N: usize> {
    size: [u32; 2],
    wrap: [Wrap; 2],
    nearest: bool,
    texels: Arc<[[u8; N]]>,
}

impl<const N: usize> Texture<N> {
    /// Creates a texture of `size[0] * size[1]` texels. Returns `None` if the count is zero or does not fit.
    pub(crate) fn new(
        size: [u32; 2],
        wrap: [Wrap; 2],
        nearest: bool,
        texels: Arc<[[u8; N]]>,
    ) -> Option<Self> {
        let count = u64::from(size[0]) * u64::from(size[1]);
        (count > 0 && count == texels.len() as u64).then_some(Self { size, wrap, nearest, texels })
    }

    /// Returns the width and height in texels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns the wrap modes of the horizontal and the vertical axis.
    #[must_use]
    pub fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// Returns whether sampling takes the nearest texel.
    #[must_use]
    pub fn nearest(&self) -> bool {
        self.nearest
    }

    /// Returns the texels, row by row from the top.
    #[must_use]
    pub fn texels(&self) -> &[[u8; N]] {
        &self.texels
    }

    /// Samples the texture at `uv`, each channel 0 to 1. The origin is the upper left corner, and 1 is the whole
    /// width or height. Sampling is bilinear between texel centres, or takes the nearest texel if the sampler says
    /// so, without mip levels. A coordinate that is not finite counts as 0.
    #[must_use]
    pub fn sample(&self, uv: Vec2) -> [f32; N] {
        let place =
            |value: f32, size: u32| if value.is_finite() { f64::from(value) * f64::from(size) } else { 0.0 };
        let (x, y) = (place(uv.x, self.size[0]), place(uv.y, self.size[1]));
        if self.nearest {
            return self.texel(x.floor() as i64, y.floor() as i64).map(|v| f32::from(v) / 255.0);
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = ((x - left) as f32, (y - top) as f32);
        let (left, top) = (left as i64, top as i64);
        let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(dx, dy)| self.texel(left.saturating_add(dx), top.saturating_add(dy)));
        std::array::from_fn(|i| {
            let [a, b, c, d] = [a[i], b[i], c[i], d[i]].map(f32::from);
            let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
            (upper + (lower - upper) * fy) / 255.0
        })
    }

    fn texel(&self, x: i64, y: i64) -> [u8; N] {
        let column = self.wrap[0].texel(x, self.size[0]);
        let row = self.wrap[1].texel(y, self.size[1]);
        self.texels[row * self.size[0] as usize + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(wrap: Wrap, nearest: bool) -> Texture<1> {
        Texture::new([4, 1], [wrap; 2], nearest, Arc::from([[0], [51], [102], [255]])).unwrap()
    }

    #[test]
    fn wraps_as_gltf_says() {
        let at = |wrap, u: f32| (ramp(wrap, true).sample(Vec2::new(u, 0.5))[0] * 255.0).round() as u8;
        assert_eq!([0.1, 0.3, 0.6, 0.9].map(|u| at(Wrap::Repeat, u)), [0, 51, 102, 255]);
        assert_eq!([1.1, -0.1, 7.3].map(|u| at(Wrap::Repeat, u)), [0, 255, 51]);
        assert_eq!([1.1, 1.9, -0.3].map(|u| at(Wrap::Mirror, u)), [255, 0, 51]);
        assert_eq!([1.1, 9.0, -0.3].map(|u| at(Wrap::Clamp, u)), [255, 255, 0]);
    }

    #[test]
    fn blends_between_centres() {
        let texture = ramp(Wrap::Repeat, false);
        let at = |u: f32| texture.sample(Vec2::new(u, 0.5))[0] * 255.0;
        assert!((at(0.125) - 0.0).abs() < 1e-3, "the centre of the first texel");
        assert!((at(0.25) - 25.5).abs() < 1e-3, "half way to the second");
        assert!((at(0.0) - 127.5).abs() < 1e-3, "half way across the seam");
    }

    #[test]
    fn odd_coordinates_and_sizes_are_harmless() {
        for wrap in [Wrap::Clamp, Wrap::Mirror, Wrap::Repeat] {
            for u in [f32::NAN, f32::INFINITY, f32::MAX, f32::MIN, -0.0] {
                for nearest in [true, false] {
                    assert!(ramp(wrap, nearest).sample(Vec2::new(u, u))[0].is_finite());
                }
            }
        }
        assert!(Texture::<1>::new([0, 4], [Wrap::Clamp; 2], true, Arc::from([])).is_none());
        assert!(Texture::<1>::new([2, 4], [Wrap::Clamp; 2], true, Arc::from([[1]])).is_none());
    }
}
