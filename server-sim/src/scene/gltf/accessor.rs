//! Accessors: typed numbers in buffers, dense or sparse. Every range is checked before it is read.

use gltf::json::Index;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

use super::document::{GltfDocument, slice};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;

/// The numbers of one accessor, element by element.
enum AccessorValues {
    /// Floats, or normalised integers converted to floats.
    Floats(Vec<f32>),
    /// Unsigned integers.
    Integers(Vec<u32>),
}

/// The type to which the numbers of an accessor are converted.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ValueType {
    /// Floats. Integers must be normalised and are scaled to 0..1 or -1..1.
    Floats,
    /// Unsigned integers.
    Integers,
}

/// Memory layout of the elements of an accessor.
#[derive(Clone, Copy)]
struct ElementFormat {
    component: ComponentType,
    width: usize,
}

impl ElementFormat {
    fn bytes(self) -> usize {
        self.component.size() * self.width
    }

    /// Appends the components of one element.
    fn read(self, element: &[u8], out: &mut AccessorValues) {
        for c in element.chunks_exact(self.component.size()) {
            match out {
                AccessorValues::Floats(list) => list.push(match (self.component, c) {
                    (ComponentType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
                    (ComponentType::U8, &[a]) => f32::from(a) / 255.0,
                    (ComponentType::I8, &[a]) => (f32::from(i8::from_le_bytes([a])) / 127.0).max(-1.0),
                    (ComponentType::U16, &[a, b]) => f32::from(u16::from_le_bytes([a, b])) / 65_535.0,
                    (ComponentType::I16, &[a, b]) => {
                        (f32::from(i16::from_le_bytes([a, b])) / 32_767.0).max(-1.0)
                    }
                    _ => 0.0,
                }),
                AccessorValues::Integers(list) => list.push(match *c {
                    [a] => u32::from(a),
                    [a, b] => u32::from(u16::from_le_bytes([a, b])),
                    [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
                    _ => 0,
                }),
            }
        }
    }
}

impl GltfDocument {
    /// Reads elements of `N` floats. Integer components must be normalised. All results are finite.
    pub(super) fn floats<const N: usize>(
        &self,
        index: Index<Accessor>,
        place: &str,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        match self.values(index, place, N, ValueType::Floats)? {
            AccessorValues::Floats(list) => Ok(list.as_chunks::<N>().0.to_vec()),
            AccessorValues::Integers(_) => Ok(Vec::new()),
        }
    }

    /// Reads elements of `N` unsigned integers.
    pub(super) fn integers<const N: usize>(
        &self,
        index: Index<Accessor>,
        place: &str,
    ) -> Result<Vec<[u32; N]>, SceneError> {
        match self.values(index, place, N, ValueType::Integers)? {
            AccessorValues::Integers(list) => Ok(list.as_chunks::<N>().0.to_vec()),
            AccessorValues::Floats(_) => Ok(Vec::new()),
        }
    }

    fn values(
        &self,
        index: Index<Accessor>,
        place: &str,
        width: usize,
        value_type: ValueType,
    ) -> Result<AccessorValues, SceneError> {
        let accessor = self.get("accessor", index, place)?;
        let here = format!("accessors[{}]", index.value());
        let fail = |problem| self.error(here.as_str(), problem);
        let format = format_of(accessor, width, value_type).map_err(fail)?;
        let count = accessor.count.0;
        if count == 0 || count > limits::MAX_ELEMENTS {
            return Err(fail(GltfProblem::TooMany { what: "elements", count, limit: limits::MAX_ELEMENTS }));
        }
        let count = count as usize;
        let mut out = match value_type {
            ValueType::Floats => AccessorValues::Floats(Vec::new()),
            ValueType::Integers => AccessorValues::Integers(Vec::new()),
        };
        match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let (bytes, stride) = self.view(view, &here)?;
                let bytes =
                    slice(bytes, offset, (bytes.len() as u64).saturating_sub(offset)).map_err(fail)?;
                read_elements(bytes, stride, count, format, &mut out).map_err(fail)?;
            }
            None => match &mut out {
                AccessorValues::Floats(list) => list.resize(count * width, 0.0),
                AccessorValues::Integers(list) => list.resize(count * width, 0),
            },
        }
        self.apply_sparse(accessor, &here, format, &mut out)?;
        if let AccessorValues::Floats(list) = &out
            && let Some(bad) = list.iter().position(|v| !v.is_finite())
        {
            return Err(fail(GltfProblem::NonFinite { element: bad / width }));
        }
        Ok(out)
    }

    /// Overwrites the elements that a sparse accessor replaces.
    fn apply_sparse(
        &self,
        accessor: &Accessor,
        here: &str,
        format: ElementFormat,
        out: &mut AccessorValues,
    ) -> Result<(), SceneError> {
        let Some(sparse) = &accessor.sparse else { return Ok(()) };
        let (count, total) = (sparse.count.0, accessor.count.0);
        let place = format!("{here}.sparse");
        let fail = |problem| self.error(place.as_str(), problem);
        if count > total {
            return Err(fail(GltfProblem::TooMany { what: "sparse elements", count, limit: total }));
        }
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(fail(GltfProblem::Invalid("indices.componentType")));
        };
        let indices = ElementFormat { component: component.0, width: 1 };
        let read = |view, offset: u64, format, mut list| {
            let (bytes, stride) = self.view(view, &place)?;
            let bytes = slice(bytes, offset, (bytes.len() as u64).saturating_sub(offset)).map_err(fail)?;
            read_elements(bytes, stride, count as usize, format, &mut list).map_err(fail)?;
            Ok(list)
        };
        let at = read(
            sparse.indices.buffer_view,
            sparse.indices.byte_offset.0,
            indices,
            AccessorValues::Integers(Vec::new()),
        )?;
        let empty = match out {
            AccessorValues::Floats(_) => AccessorValues::Floats(Vec::new()),
            AccessorValues::Integers(_) => AccessorValues::Integers(Vec::new()),
        };
        let values = read(sparse.values.buffer_view, sparse.values.byte_offset.0, format, empty)?;
        let AccessorValues::Integers(at) = at else { return Ok(()) };
        let width = format.width;
        for (i, &element) in at.iter().enumerate() {
            let element = element as usize;
            if element as u64 >= total {
                return Err(fail(GltfProblem::OutOfRange {
                    what: "element",
                    index: element,
                    count: total as usize,
                }));
            }
            let (to, from) = (element * width..(element + 1) * width, i * width..(i + 1) * width);
            match (&mut *out, &values) {
                (AccessorValues::Floats(out), AccessorValues::Floats(values)) => {
                    out[to].copy_from_slice(&values[from]);
                }
                (AccessorValues::Integers(out), AccessorValues::Integers(values)) => {
                    out[to].copy_from_slice(&values[from]);
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Checks that an accessor can be read as the given type.
fn format_of(accessor: &Accessor, width: usize, value_type: ValueType) -> Result<ElementFormat, GltfProblem> {
    let Checked::Valid(component) = accessor.component_type else {
        return Err(GltfProblem::Invalid("componentType"));
    };
    let Checked::Valid(kind) = accessor.type_ else { return Err(GltfProblem::Invalid("type")) };
    let component = component.0;
    let expected = match (value_type, width) {
        (ValueType::Integers, 1) => "SCALAR of unsigned integers",
        (ValueType::Integers, _) => "VEC4 of unsigned integers",
        (ValueType::Floats, 1) => "SCALAR of floats",
        (ValueType::Floats, 2) => "VEC2 of floats",
        (ValueType::Floats, 3) => "VEC3 of floats",
        (ValueType::Floats, 4) => "VEC4 of floats",
        (ValueType::Floats, _) => "MAT4 of floats",
    };
    let unsigned = matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
    let fits = match value_type {
        ValueType::Integers => unsigned && !accessor.normalized,
        ValueType::Floats if component == ComponentType::F32 => true,
        ValueType::Floats => accessor.normalized && component != ComponentType::U32 && kind != Type::Mat4,
    };
    if fits && kind.multiplicity() == width && !matches!(kind, Type::Mat2 | Type::Mat3) {
        Ok(ElementFormat { component, width })
    } else {
        let sign = if accessor.normalized { "normalized " } else { "" };
        Err(GltfProblem::WrongType { expected, found: format!("{kind:?} of {sign}{component:?}") })
    }
}

/// Reads `count` elements that lie `stride` bytes apart, or adjacent without a stride.
fn read_elements(
    bytes: &[u8],
    stride: Option<usize>,
    count: usize,
    format: ElementFormat,
    out: &mut AccessorValues,
) -> Result<(), GltfProblem> {
    if count == 0 {
        return Ok(());
    }
    let size = format.bytes();
    let stride = stride.unwrap_or(size);
    if stride < size {
        return Err(GltfProblem::Invalid("byteStride"));
    }
    let length = (stride as u64).saturating_mul(count as u64 - 1).saturating_add(size as u64);
    let bytes = slice(bytes, 0, length)?;
    for element in bytes.chunks(stride) {
        format.read(&element[..size], out);
    }
    Ok(())
}
