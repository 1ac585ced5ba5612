//! Triangles of a primitive in any of the three modes (glTF 2.0, section 3.7.2.1).

/// How the corners of a primitive form surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Points,
    Lines,
    Triangles,
    TriangleStrip,
    TriangleFan,
}

impl Mode {
    /// Returns the mode of a code, or `None` if glTF does not define it. Without a code, corners form triangles.
    pub(super) fn new(code: Option<u32>) -> Option<Self> {
        Some(match code.unwrap_or(4) {
            0 => Self::Points,
            1..=3 => Self::Lines,
            4 => Self::Triangles,
            5 => Self::TriangleStrip,
            6 => Self::TriangleFan,
            _ => return None,
        })
    }

    /// Returns the triangles of a list of corners, and whether corners are left over, which are to be ignored.
    pub(super) fn triangles(self, corners: &[u32]) -> (Vec<[u32; 3]>, bool) {
        match self {
            Self::Points | Self::Lines => (Vec::new(), false),
            Self::Triangles => {
                let (whole, rest) = corners.as_chunks::<3>();
                (whole.to_vec(), !rest.is_empty())
            }
            Self::TriangleStrip => {
                let odd = |(i, w): (usize, &[u32])| {
                    if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] }
                };
                (corners.windows(3).enumerate().map(odd).collect(), matches!(corners.len(), 1 | 2))
            }
            Self::TriangleFan => {
                let around = corners.get(1..).unwrap_or_default().windows(2);
                (around.map(|w| [w[0], w[1], corners[0]]).collect(), matches!(corners.len(), 1 | 2))
            }
        }
    }
}
