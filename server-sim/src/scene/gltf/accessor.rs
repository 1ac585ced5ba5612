//! Accessors: typed numbers in buffers, dense or sparse. Every range is checked before it is read.

use super::document::{GltfDocument, slice};
use super::schema::Accessor;
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;

/// Types of the components of an accessor (glTF 2.0, section 3.6.2.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ComponentType {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl ComponentType {
    fn new(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// The numbers of one accessor, element by element.
enum AccessorValues {
    Floats(Vec<f32>),
    /// Unsigned integers.
    Integers(Vec<u32>),
}

/// The type to which the numbers of an accessor are converted.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ValueType {
    /// Floats. Normalised integers are scaled to 0..1 or -1..1; others keep their value (`KHR_mesh_quantization`).
    Floats,
    /// Unsigned integers.
    Integers,
}

/// Memory layout of the elements of an accessor.
#[derive(Clone, Copy)]
struct ElementFormat {
    component: ComponentType,
    normalized: bool,
    width: usize,
}

impl ElementFormat {
    fn bytes(self) -> usize {
        self.component.bytes() * self.width
    }

    /// Appends the components of one element.
    fn read(self, element: &[u8], out: &mut AccessorValues) {
        for c in element.chunks_exact(self.component.bytes()) {
            match out {
                AccessorValues::Floats(list) => list.push(self.float(c)),
                AccessorValues::Integers(list) => list.push(match *c {
                    [a] => u32::from(a),
                    [a, b] => u32::from(u16::from_le_bytes([a, b])),
                    [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
                    _ => 0,
                }),
            }
        }
    }

    fn float(self, component: &[u8]) -> f32 {
        let (value, most) = match (self.component, component) {
            (ComponentType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
            (ComponentType::U8, &[a]) => (f32::from(a), 255.0),
            (ComponentType::I8, &[a]) => (f32::from(a.cast_signed()), 127.0),
            (ComponentType::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65_535.0),
            (ComponentType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32_767.0),
            _ => (0.0, 1.0),
        };
        if self.normalized { (value / most).max(-1.0) } else { value }
    }
}

impl GltfDocument {
    /// Reads elements of `N` floats. All results are finite.
    pub(super) fn floats<const N: usize>(
        &self,
        index: usize,
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
        index: usize,
        place: &str,
    ) -> Result<Vec<[u32; N]>, SceneError> {
        match self.values(index, place, N, ValueType::Integers)? {
            AccessorValues::Integers(list) => Ok(list.as_chunks::<N>().0.to_vec()),
            AccessorValues::Floats(_) => Ok(Vec::new()),
        }
    }

    /// Returns an accessor without reading it.
    pub(super) fn accessor(&self, index: usize, place: &str) -> Result<&Accessor, SceneError> {
        self.get("accessor", &self.root.accessors, index, place)
    }

    fn values(
        &self,
        index: usize,
        place: &str,
        width: usize,
        value_type: ValueType,
    ) -> Result<AccessorValues, SceneError> {
        let accessor = self.accessor(index, place)?;
        let here = format!("accessors[{index}]");
        let fail = |problem| self.error(here.as_str(), problem);
        let format = format_of(accessor, width, value_type).map_err(fail)?;
        let count = accessor.count;
        if count > limits::MAX_ELEMENTS {
            return Err(fail(GltfProblem::TooMany { what: "elements", count, limit: limits::MAX_ELEMENTS }));
        }
        self.spend_numbers(count * width as u64, &here)?;
        let count = count as usize;
        let mut out = match value_type {
            ValueType::Floats => AccessorValues::Floats(Vec::new()),
            ValueType::Integers => AccessorValues::Integers(Vec::new()),
        };
        match accessor.buffer_view.filter(|_| count > 0) {
            Some(view) => {
                let offset = accessor.byte_offset;
                let (bytes, stride) = self.view(view, &here)?;
                let bytes =
                    slice(bytes, offset, (bytes.len() as u64).saturating_sub(offset)).map_err(fail)?;
                read_elements(bytes, stride, count, format, &mut out).map_err(fail)?;
            }
            // Without a view all numbers are zero (section 3.6.2.3).
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
        let (count, total) = (sparse.count, accessor.count);
        let place = format!("{here}.sparse");
        let fail = |problem| self.error(place.as_str(), problem);
        if count > total {
            return Err(fail(GltfProblem::TooMany { what: "sparse elements", count, limit: total }));
        }
        let component = ComponentType::new(sparse.indices.component_type)
            .filter(|c| matches!(c, ComponentType::U8 | ComponentType::U16 | ComponentType::U32))
            .ok_or_else(|| fail(GltfProblem::Invalid("indices.componentType")))?;
        let indices = ElementFormat { component, normalized: false, width: 1 };
        let read = |view, offset: u64, format, mut list| {
            let (bytes, stride) = self.view(view, &place)?;
            let bytes = slice(bytes, offset, (bytes.len() as u64).saturating_sub(offset)).map_err(fail)?;
            read_elements(bytes, stride, count as usize, format, &mut list).map_err(fail)?;
            Ok(list)
        };
        let places = &sparse.indices;
        let at = read(places.buffer_view, places.byte_offset, indices, AccessorValues::Integers(Vec::new()))?;
        let empty = match out {
            AccessorValues::Floats(_) => AccessorValues::Floats(Vec::new()),
            AccessorValues::Integers(_) => AccessorValues::Integers(Vec::new()),
        };
        let values = read(sparse.values.buffer_view, sparse.values.byte_offset, format, empty)?;
        let AccessorValues::Integers(at) = at else { return Ok(()) };
        replace(&at, &values, format.width, out).map_err(fail)
    }
}

/// Copies each element of `values` to its place.
fn replace(
    at: &[u32],
    values: &AccessorValues,
    width: usize,
    out: &mut AccessorValues,
) -> Result<(), GltfProblem> {
    let total = match out {
        AccessorValues::Floats(list) => list.len() / width,
        AccessorValues::Integers(list) => list.len() / width,
    };
    for (i, &element) in at.iter().enumerate() {
        let element = element as usize;
        if element >= total {
            return Err(GltfProblem::OutOfRange { what: "element", index: element, count: total });
        }
        let (to, from) = (element * width..(element + 1) * width, i * width..(i + 1) * width);
        match (&mut *out, values) {
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

/// Checks that an accessor can be read as the given type.
fn format_of(accessor: &Accessor, width: usize, value_type: ValueType) -> Result<ElementFormat, GltfProblem> {
    let component =
        ComponentType::new(accessor.component_type).ok_or(GltfProblem::Invalid("componentType"))?;
    let (kind, expected) = match (value_type, width) {
        (ValueType::Integers, 1) => ("SCALAR", "SCALAR of unsigned integers"),
        (ValueType::Integers, _) => ("VEC4", "VEC4 of unsigned integers"),
        (ValueType::Floats, 1) => ("SCALAR", "SCALAR of floats"),
        (ValueType::Floats, 2) => ("VEC2", "VEC2 of floats"),
        (ValueType::Floats, 3) => ("VEC3", "VEC3 of floats"),
        (ValueType::Floats, 4) => ("VEC4", "VEC4 of floats"),
        (ValueType::Floats, _) => ("MAT4", "MAT4 of floats"),
    };
    let normalized = accessor.normalized;
    let fits = match (value_type, component) {
        (ValueType::Integers, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) => !normalized,
        (ValueType::Integers, _) | (ValueType::Floats, ComponentType::U32) => false,
        (ValueType::Floats, ComponentType::F32) => true,
        (ValueType::Floats, _) => width <= 4,
    };
    if fits && kind == accessor.kind {
        Ok(ElementFormat { component, normalized, width })
    } else {
        let sign = if normalized { "normalized " } else { "" };
        let found = format!("{} of {sign}{component:?}", accessor.kind.escape_debug());
        Err(GltfProblem::WrongType { expected, found })
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
