//! Filters: the last step from unpacked elements to vectors, rotations and floats (appendix B).

use super::MeshoptError;

/// What the bytes of an element stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Filter {
    /// The bytes themselves.
    None,
    /// A unit vector on an octahedron.
    Octahedral,
    /// A rotation without its largest component.
    Quaternion,
    /// Floats as mantissa and exponent.
    Exponential,
    /// A colour. No surface depends on it, so its bytes stay as they are.
    Colour,
}

impl Filter {
    /// Returns the filter of this name if it allows elements of `stride` bytes.
    pub(super) fn new(name: &str, stride: usize) -> Result<Self, MeshoptError> {
        let (filter, fits) = match name {
            "NONE" => (Self::None, true),
            "OCTAHEDRAL" => (Self::Octahedral, matches!(stride, 4 | 8)),
            "QUATERNION" => (Self::Quaternion, stride == 8),
            "EXPONENTIAL" => (Self::Exponential, stride.is_multiple_of(4)),
            "COLOR" => (Self::Colour, matches!(stride, 4 | 8)),
            _ => return Err(MeshoptError::Filter),
        };
        if fits { Ok(filter) } else { Err(MeshoptError::Layout) }
    }

    /// Applies the filter in place.
    pub(super) fn apply(self, stride: usize, bytes: &mut [u8]) {
        match self {
            Self::None | Self::Colour => {}
            Self::Octahedral if stride == 4 => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|element| {
                let [x, y, z, w] = element.map(|byte| i32::from(byte.cast_signed()));
                let [x, y, z] = octahedral([x, y, z], 127.0);
                *element = [x as u8, y as u8, z as u8, w as u8];
            }),
            Self::Octahedral => bytes.as_chunks_mut::<8>().0.iter_mut().for_each(|element| {
                let [x, y, z, w] = words(element);
                let [x, y, z] = octahedral([x, y, z], 32_767.0);
                *element = from_words([x, y, z, w]);
            }),
            Self::Quaternion => bytes.as_chunks_mut::<8>().0.iter_mut().for_each(|element| {
                *element = from_words(quaternion(words(element)));
            }),
            Self::Exponential => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|element| {
                *element = exponential(i32::from_le_bytes(*element)).to_le_bytes();
            }),
        }
    }
}

fn words(bytes: &[u8; 8]) -> [i32; 4] {
    [0, 2, 4, 6].map(|k| i32::from(i16::from_le_bytes([bytes[k], bytes[k + 1]])))
}

fn from_words(words: [i32; 4]) -> [u8; 8] {
    let mut out = [0; 8];
    for (slot, word) in out.as_chunks_mut::<2>().0.iter_mut().zip(words) {
        *slot = (word as i16).to_le_bytes();
    }
    out
}

/// Returns a unit vector as integers up to `most`, from its place on an octahedron. The third number is 1 in the units
/// of the first two.
fn octahedral([x, y, one]: [i32; 3], most: f32) -> [i32; 3] {
    let one = one as f32;
    let (mut x, mut y) = (x as f32 / one, y as f32 / one);
    let z = 1.0 - x.abs() - y.abs();
    let fold = z.min(0.0);
    x -= fold.copysign(x);
    y -= fold.copysign(y);
    let length = (x * x + y * y + z * z).sqrt();
    // A damaged vector gives numbers that are none, and those become 0.
    [x, y, z].map(|v| (v / length * most).round() as i32)
}

/// Returns a rotation as integers up to 32,767 from its three smaller components. The fourth number is 1 in their units,
/// with the place of the largest component in its lowest two bits.
fn quaternion(packed: [i32; 4]) -> [i32; 4] {
    let one = (packed[3] | 3) as f32;
    let part = |k: usize| packed[k] as f32 / one * std::f32::consts::FRAC_1_SQRT_2;
    let (x, y, z) = (part(0), part(1), part(2));
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = (packed[3] & 3) as usize;
    let mut out = [0; 4];
    for (k, v) in [w, x, y, z].into_iter().enumerate() {
        out[(largest + k) % 4] = (v * 32_767.0).round() as i32;
    }
    out
}

/// Returns a float from a mantissa of 24 bits and an exponent of 8. The exponent is clamped to its valid range.
fn exponential(packed: i32) -> f32 {
    let (exponent, mantissa) = ((packed >> 24).clamp(-100, 100), packed << 8 >> 8);
    let power = f32::from_bits(((exponent + 127) as u32) << 23);
    mantissa as f32 * power
}
