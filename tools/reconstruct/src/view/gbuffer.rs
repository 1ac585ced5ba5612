//! The G-buffer: the nearest surface at every pixel of a view.

use glam::Vec3;

use super::Size;

/// A point of a surface that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Distance along the ray in metres, at least 0.
    pub t: f32,
    /// Position in metres, world space.
    pub position: Vec3,
    /// Unit shading normal (normal map included), world space, facing the ray's origin.
    pub normal: Vec3,
    /// Index of its instance, as in the stream's layout.
    pub instance: u32,
    /// Place on the mesh at rest. Profile `surface` needs it; profile `paper` does not.
    pub rest: Option<AtRest>,
}

/// A point of a surface on the mesh at rest, before skinning and morphing.
///
/// A renderer interpolates position and normal as vertex attributes over the triangle, without any transform. The chart is
/// constant over a triangle: a flat attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtRest {
    /// Position in metres, rest space of the mesh.
    pub position: Vec3,
    /// Unit shading normal in rest space. The normal map acts in the tangent space at rest. On the backs of faces it is
    /// reversed, as [`Surface::normal`] is. A zero normal means that the place at rest is missing.
    pub normal: Vec3,
    /// Number of the chart of the triangle's visible side, see [`Charts`](psao_codec::surface::Charts).
    pub chart: u32,
}

/// The nearest surface at each pixel, row by row from the top left. Background has no surface.
#[derive(Clone, Debug, PartialEq)]
pub struct GBuffer {
    size: Size,
    depth: Vec<f32>,
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    instance: Vec<u32>,
    /// Zero normals where a fragment lacks its place at rest; `None` when all fragments lack it.
    rest: Option<RestPlanes>,
}

/// Places at rest, row by row.
#[derive(Clone, Debug, PartialEq)]
struct RestPlanes {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    chart: Vec<u32>,
}

impl RestPlanes {
    fn new(size: Size) -> Self {
        let pixels = size.pixels();
        Self { position: vec![Vec3::ZERO; pixels], normal: vec![Vec3::ZERO; pixels], chart: vec![0; pixels] }
    }
}

/// A number of fragments that does not fill the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an image of {size} pixels needs {} fragments, not {found}", size.pixels())]
pub struct FragmentCountError {
    /// The requested size.
    pub size: Size,
    /// The number of fragments given.
    pub found: usize,
}

impl GBuffer {
    /// The instance of a background pixel: no instance has this index.
    pub const NO_INSTANCE: u32 = u32::MAX;

    /// Makes a buffer of one optional surface per pixel, row by row from the top left.
    ///
    /// # Errors
    ///
    /// [`FragmentCountError`] when there are not `size.pixels()` fragments.
    pub fn from_fragments(size: Size, fragments: Vec<Option<Surface>>) -> Result<Self, FragmentCountError> {
        if fragments.len() != size.pixels() {
            return Err(FragmentCountError { size, found: fragments.len() });
        }
        Ok(Self::gather(size, fragments))
    }

    /// Writes fragments, one a pixel, to the planes of the buffer.
    pub(super) fn gather(size: Size, fragments: Vec<Option<Surface>>) -> Self {
        let mut buffer = Self {
            size,
            depth: vec![f32::INFINITY; size.pixels()],
            position: vec![Vec3::ZERO; size.pixels()],
            normal: vec![Vec3::ZERO; size.pixels()],
            instance: vec![Self::NO_INSTANCE; size.pixels()],
            rest: None,
        };
        for (pixel, surface) in fragments.into_iter().enumerate() {
            if let Some(surface) = surface {
                buffer.depth[pixel] = surface.t;
                buffer.position[pixel] = surface.position;
                buffer.normal[pixel] = surface.normal;
                buffer.instance[pixel] = surface.instance;
                if let Some(rest) = surface.rest {
                    let planes = buffer.rest.get_or_insert_with(|| RestPlanes::new(size));
                    planes.position[pixel] = rest.position;
                    planes.normal[pixel] = rest.normal;
                    planes.chart[pixel] = rest.chart;
                }
            }
        }
        buffer
    }

    /// Returns the width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns the distances from the eye along the rays in metres; infinite for background.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Returns the positions in metres, world space; zero for background.
    pub fn position(&self) -> &[Vec3] {
        &self.position
    }

    /// Returns the unit shading normals, facing the eye, world space; zero for background.
    pub fn normal(&self) -> &[Vec3] {
        &self.normal
    }

    /// Returns the instances; [`GBuffer::NO_INSTANCE`] for background.
    pub fn instance(&self) -> &[u32] {
        &self.instance
    }

    /// Returns the positions on the meshes at rest, in metres, rest space; `None` when all surfaces lack them. They are
    /// zero for background and where a surface lacks its place at rest.
    pub fn rest_position(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.position.as_slice())
    }

    /// Returns the unit shading normals on the meshes at rest, rest space; `None` when all surfaces lack them. They are
    /// zero for background and where a surface lacks its place at rest.
    pub fn rest_normal(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.normal.as_slice())
    }

    /// Returns the charts of the places at rest; `None` when all surfaces lack them. They are 0 for background and where a
    /// surface lacks its place at rest.
    pub fn rest_chart(&self) -> Option<&[u32]> {
        self.rest.as_ref().map(|planes| planes.chart.as_slice())
    }

    /// Returns the place at rest of pixel number `pixel`; `None` for background, beyond the image, and where the
    /// surface lacks it.
    #[inline]
    pub fn at_rest(&self, pixel: usize) -> Option<AtRest> {
        let planes = self.rest.as_ref()?;
        let normal = *planes.normal.get(pixel)?;
        (normal != Vec3::ZERO).then(|| AtRest {
            position: planes.position[pixel],
            normal,
            chart: planes.chart[pixel],
        })
    }

    /// Returns the surface of pixel number `pixel` (row times width plus column); `None` for background and beyond
    /// the image.
    pub fn fragment(&self, pixel: usize) -> Option<Surface> {
        let instance = *self.instance.get(pixel)?;
        (instance != Self::NO_INSTANCE).then(|| Surface {
            t: self.depth[pixel],
            position: self.position[pixel],
            normal: self.normal[pixel],
            instance,
            rest: self.at_rest(pixel),
        })
    }

    /// Returns the number of pixels that show a surface.
    pub fn covered(&self) -> usize {
        self.instance.iter().filter(|&&instance| instance != Self::NO_INSTANCE).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fragments_must_fill_the_image() {
        let size = Size::new(3, 2).unwrap();
        assert_eq!(GBuffer::from_fragments(size, vec![None; 5]), Err(FragmentCountError { size, found: 5 }));
        let fragment = Surface { t: 2.0, position: Vec3::ONE, normal: Vec3::X, instance: 7, rest: None };
        let buffer =
            GBuffer::from_fragments(size, vec![None, Some(fragment), None, None, None, None]).unwrap();
        assert_eq!(buffer.fragment(1), Some(fragment));
        assert_eq!(buffer.covered(), 1);
        assert_eq!(
            (buffer.rest_position(), buffer.rest_normal()),
            (None, None),
            "nobody pays for what is not used"
        );
    }

    #[test]
    fn places_at_rest_are_kept_where_they_are_given() {
        let without = Surface { t: 2.0, position: Vec3::ONE, normal: Vec3::X, instance: 7, rest: None };
        let rest = AtRest { position: Vec3::new(0.5, -1.0, 2.0), normal: Vec3::NEG_Y, chart: 3 };
        let with = Surface { rest: Some(rest), ..without };
        let fragments = vec![Some(with), None, Some(without)];
        let buffer = GBuffer::from_fragments(Size::new(3, 1).unwrap(), fragments.clone()).unwrap();
        assert_eq!((0..3).map(|pixel| buffer.fragment(pixel)).collect::<Vec<_>>(), fragments);
        assert_eq!([0, 1, 2, 3].map(|pixel| buffer.at_rest(pixel)), [Some(rest), None, None, None]);
        assert_eq!(buffer.rest_position(), Some([rest.position, Vec3::ZERO, Vec3::ZERO].as_slice()));
        assert_eq!(buffer.rest_normal(), Some([rest.normal, Vec3::ZERO, Vec3::ZERO].as_slice()));
        assert_eq!(buffer.rest_chart(), Some([3, 0, 0].as_slice()));
    }
}
