//! What the camera sees: the nearest surface of every pixel.

use glam::Vec3;

use super::Size;

/// A point of a surface, as a ray meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Distance along the ray in metres, at least 0.
    pub t: f32,
    /// Where it is, in metres, world space.
    pub position: Vec3,
    /// Its unit shading normal (normal map included), world space, facing the ray's origin.
    pub normal: Vec3,
    /// Index of the instance that it belongs to, the same as in the stream's layout.
    pub instance: u32,
    /// Where it is on the mesh at rest. Profile `surface` needs it; for profile `paper` it may be left out.
    pub rest: Option<AtRest>,
}

/// A point of a surface on the mesh at rest: unskinned and unmorphed, whatever its instance does.
///
/// A renderer has both as vertex attributes that are interpolated over the triangle, without any transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtRest {
    /// Where it is, in metres, rest space of the mesh.
    pub position: Vec3,
    /// Its unit shading normal there: the normal map bends it in the tangent space at rest, and it is turned round
    /// where [`Surface::normal`] is, on the backs of faces. A zero normal counts as none given.
    pub normal: Vec3,
}

/// The nearest surface of each pixel, row by row from the top left. Background has none.
#[derive(Clone, Debug, PartialEq)]
pub struct GBuffer {
    size: Size,
    depth: Vec<f32>,
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    instance: Vec<u32>,
    /// Zero normals where a fragment does not say; `None` when none does.
    rest: Option<RestPlanes>,
}

/// Places at rest, row by row.
#[derive(Clone, Debug, PartialEq)]
struct RestPlanes {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
}

impl RestPlanes {
    fn new(size: Size) -> Self {
        Self { position: vec![Vec3::ZERO; size.pixels()], normal: vec![Vec3::ZERO; size.pixels()] }
    }
}

/// Fragments that do not fill an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an image of {size} pixels needs {} fragments, not {found}", size.pixels())]
pub struct FragmentCountError {
    /// The size asked for.
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

    /// Spreads fragments, one a pixel, over the planes of the buffer.
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
                }
            }
        }
        buffer
    }

    /// Width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Distance from the eye along the ray in metres; infinite for background.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Positions in metres, world space; zero for background.
    pub fn position(&self) -> &[Vec3] {
        &self.position
    }

    /// Unit shading normals facing the eye, world space; zero for background.
    pub fn normal(&self) -> &[Vec3] {
        &self.normal
    }

    /// Instances; [`GBuffer::NO_INSTANCE`] for background.
    pub fn instance(&self) -> &[u32] {
        &self.instance
    }

    /// Positions on the meshes at rest, in metres, rest space; zero for background and for surfaces that do not say.
    /// `None` when no surface says.
    pub fn rest_position(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.position.as_slice())
    }

    /// Unit shading normals on the meshes at rest, rest space; zero for background and for surfaces that do not say.
    /// `None` when no surface says.
    pub fn rest_normal(&self) -> Option<&[Vec3]> {
        self.rest.as_ref().map(|planes| planes.normal.as_slice())
    }

    /// The place at rest of pixel number `pixel`; `None` for background, beyond the image, and where the surface
    /// does not say.
    #[inline]
    pub fn at_rest(&self, pixel: usize) -> Option<AtRest> {
        let planes = self.rest.as_ref()?;
        let normal = *planes.normal.get(pixel)?;
        (normal != Vec3::ZERO).then(|| AtRest { position: planes.position[pixel], normal })
    }

    /// The surface of pixel number `pixel` (row times width plus column); `None` for background and beyond
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

    /// Number of pixels that show a surface.
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
        let rest = AtRest { position: Vec3::new(0.5, -1.0, 2.0), normal: Vec3::NEG_Y };
        let with = Surface { rest: Some(rest), ..without };
        let fragments = vec![Some(with), None, Some(without)];
        let buffer = GBuffer::from_fragments(Size::new(3, 1).unwrap(), fragments.clone()).unwrap();
        assert_eq!((0..3).map(|pixel| buffer.fragment(pixel)).collect::<Vec<_>>(), fragments);
        assert_eq!([0, 1, 2, 3].map(|pixel| buffer.at_rest(pixel)), [Some(rest), None, None, None]);
        assert_eq!(buffer.rest_position(), Some([rest.position, Vec3::ZERO, Vec3::ZERO].as_slice()));
        assert_eq!(buffer.rest_normal(), Some([rest.normal, Vec3::ZERO, Vec3::ZERO].as_slice()));
    }
}
