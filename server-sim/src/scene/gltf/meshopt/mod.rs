//! Buffer views of `EXT_meshopt_compression` and `KHR_meshopt_compression`, unpacked as the latter's specification says
//! (appendices A and B). It includes the former, version 0 of the attributes.

mod attributes;
mod filter;
mod indices;
mod triangles;

#[cfg(test)]
pub(super) mod tests;

/// Number and size of the elements of a buffer view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) count: usize,
    /// Bytes of one element.
    pub(super) stride: usize,
}

/// Reason why compressed bytes cannot be unpacked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum MeshoptError {
    #[error("the mode must be ATTRIBUTES, TRIANGLES or INDICES")]
    Mode,
    #[error("the filter must be NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR")]
    Filter,
    #[error("mode and filter do not allow this count or byteStride")]
    Layout,
    #[error("the version of the compressed data is unknown")]
    Version,
    #[error("the compressed data ends too early")]
    End,
    #[error("bytes are left over after the compressed data")]
    Rest,
    #[error("the compressed data has a code that the specification does not define")]
    Code,
}

/// Unpacks a buffer view. Memory grows with what was read: at most 1,024 bytes for each byte of `bytes`.
pub(super) fn decode(
    mode: &str,
    filter: &str,
    layout: Layout,
    bytes: &[u8],
) -> Result<Vec<u8>, MeshoptError> {
    let filter = filter::Filter::new(filter, layout.stride)?;
    let Layout { count, stride } = layout;
    let of_indices = matches!(stride, 2 | 4) && filter == filter::Filter::None;
    match mode {
        "ATTRIBUTES" if stride.is_multiple_of(4) && (4..=256).contains(&stride) => {
            let mut out = attributes::decode(layout, bytes)?;
            filter.apply(stride, &mut out);
            Ok(out)
        }
        "TRIANGLES" if of_indices && count.is_multiple_of(3) => triangles::decode(layout, bytes),
        "INDICES" if of_indices => indices::decode(layout, bytes),
        "ATTRIBUTES" | "TRIANGLES" | "INDICES" => Err(MeshoptError::Layout),
        _ => Err(MeshoptError::Mode),
    }
}
