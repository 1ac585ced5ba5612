//! Data packed by meshoptimizer 1.3, in every mode and both versions of the attributes.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;

use super::*;

#[derive(Deserialize)]
struct Vector {
    name: String,
    mode: String,
    filter: String,
    count: usize,
    stride: usize,
    data: String,
    /// What the library's own decoder gives, for filters.
    unpacked: Option<String>,
}

impl Vector {
    fn layout(&self) -> Layout {
        Layout { count: self.count, stride: self.stride }
    }

    fn packed(&self) -> Vec<u8> {
        STANDARD.decode(&self.data).unwrap()
    }

    fn unpack(&self, packed: &[u8]) -> Result<Vec<u8>, MeshoptError> {
        decode(&self.mode, &self.filter, self.layout(), packed)
    }
}

fn vectors() -> Vec<Vector> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/gltf/meshopt.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn bytes(count: u32, byte: impl Fn(u32) -> u32) -> Vec<u8> {
    (0..count).map(|i| byte(i) as u8).collect()
}

/// Indices of `stride` bytes.
fn indices(stride: usize, list: impl IntoIterator<Item = u32>) -> Vec<u8> {
    list.into_iter().flat_map(|index| index.to_le_bytes()[..stride].to_vec()).collect()
}

/// Two triangles in each cell of a grid, and two triangles across it.
fn grid() -> Vec<[u32; 3]> {
    let cells = (0..6).flat_map(|y| (0..6).map(move |x| y * 7 + x));
    let mut list: Vec<[u32; 3]> = cells.flat_map(|a| [[a, a + 1, a + 7], [a + 7, a + 1, a + 8]]).collect();
    list.extend([[0, 20, 48], [48, 3, 7]]);
    list
}

/// Returns a triangle that begins with its smallest index. The encoder turns triangles.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
}

/// Returns what was packed, by the formulas that made the file.
fn source(vector: &Vector) -> Option<Vec<u8>> {
    Some(match vector.name.as_str() {
        "smooth" => bytes(2_400, |i| {
            let e = i >> 3;
            [e, e >> 8, e * 3, (e * 3) >> 8, 7, 0, (e * e) >> 4, (e * e) >> 12][(i & 7) as usize]
        }),
        "noise" => bytes(80, |i| (i * i * 167 + i * 13) >> 3),
        "floats" => (0..120_u8).flat_map(|i| (f32::from(i) * 0.25 - 7.0).to_le_bytes()).collect(),
        "strip" => indices(vector.stride, (0..60).map(|i| if i % 2 == 1 { 1_000 + i } else { 3 * i })),
        // The encoder stores both as bits that differ, turned by 1 and 3.
        "scattered bits" => indices(4, (0..64_u32).map(|i| i.wrapping_mul(2_654_435_761) & 0x80ff_0000)),
        "upper bits" => {
            indices(4, (0..64).map(|i| 0x4000_0000 ^ (((i * (i + 3)) & 0xf) << 12) ^ ((i & 1) << 31)))
        }
        _ => return None,
    })
}

#[test]
fn packed_numbers_come_back_as_they_were() {
    let mut seen = 0;
    for vector in vectors() {
        let Some(source) = source(&vector) else { continue };
        assert_eq!(vector.unpack(&vector.packed()).unwrap(), source, "{}", vector.name);
        seen += 1;
    }
    assert_eq!(seen, 12);
}

#[test]
fn packed_triangles_come_back_up_to_their_first_corner() {
    for vector in vectors().iter().filter(|vector| vector.name == "grid") {
        let unpacked = vector.unpack(&vector.packed()).unwrap();
        let list: Vec<u32> = unpacked
            .chunks(vector.stride)
            .map(|index| index.iter().rev().fold(0, |sum, byte| sum << 8 | u32::from(*byte)))
            .collect();
        let found: Vec<[u32; 3]> = list.as_chunks::<3>().0.iter().map(|triangle| turned(*triangle)).collect();
        assert_eq!(found, grid().into_iter().map(turned).collect::<Vec<_>>());
    }
}

#[test]
fn filters_agree_with_the_library_to_the_last_place() {
    for vector in vectors() {
        let Some(expected) = &vector.unpacked else { continue };
        let (found, expected) =
            (vector.unpack(&vector.packed()).unwrap(), STANDARD.decode(expected).unwrap());
        assert_eq!(found.len(), expected.len());
        // The specification allows one unit of the decoded numbers, but none for the exponential filter.
        match (vector.filter.as_str(), vector.stride) {
            ("OCTAHEDRAL", 4) => {
                for (a, b) in found.iter().zip(&expected) {
                    assert!(a.cast_signed().abs_diff(b.cast_signed()) <= 1, "{}", vector.name);
                }
            }
            ("EXPONENTIAL", _) => assert_eq!(found, expected),
            _ => {
                for (a, b) in found.as_chunks::<2>().0.iter().zip(expected.as_chunks::<2>().0) {
                    let [a, b] = [*a, *b].map(i16::from_le_bytes);
                    assert!(a.abs_diff(b) <= 1, "{}: {a} {b}", vector.name);
                }
            }
        }
    }
}

#[test]
fn the_example_of_the_specification_is_read_as_it_says() {
    // One group of 4-bit differences; the element counts and the tail are ours.
    let group = [0x17, 0x5f, 0xf0, 0xbc, 0x77, 0xa9, 0x21, 0x00, 0x34, 0xb5];
    let mut packed = vec![0xa0, 0b10];
    packed.extend(group);
    packed.extend([0, 0, 0]); // the other three bytes of each element have no differences
    packed.extend([0; 32]);
    let unpacked = decode("ATTRIBUTES", "NONE", Layout { count: 16, stride: 4 }, &packed).unwrap();
    let differences = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0];
    let mut value = 0_i8;
    for (element, difference) in unpacked.chunks(4).zip(differences) {
        value = value.wrapping_add(difference);
        assert_eq!(element, [value.cast_unsigned(), 0, 0, 0]);
    }
}

#[test]
fn damaged_data_is_an_error_or_other_numbers() {
    for vector in vectors() {
        let whole = vector.packed();
        for end in 0..whole.len() {
            assert!(vector.unpack(&whole[..end]).is_err(), "{}, cut at {end}", vector.name);
        }
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut bad = whole.clone();
                bad[at] ^= 1 << bit;
                if let Ok(unpacked) = vector.unpack(&bad) {
                    assert_eq!(unpacked.len(), vector.count * vector.stride);
                }
            }
        }
        // A count that the data does not have ends with the data, not with the memory.
        let layout = Layout { count: vector.count + 30_000_000_000, ..vector.layout() };
        assert!(decode(&vector.mode, &vector.filter, layout, &whole).is_err());
    }
}

#[test]
fn modes_filters_and_layouts_are_checked() {
    let fail = |mode, filter, count, stride| {
        decode(mode, filter, Layout { count, stride }, &[0xa0; 64]).unwrap_err()
    };
    assert_eq!(fail("COLOURS", "NONE", 3, 4), MeshoptError::Mode);
    assert_eq!(fail("ATTRIBUTES", "SMOOTH", 3, 4), MeshoptError::Filter);
    assert_eq!(fail("ATTRIBUTES", "QUATERNION", 3, 4), MeshoptError::Layout);
    for stride in [0, 3, 260] {
        assert_eq!(fail("ATTRIBUTES", "NONE", 3, stride), MeshoptError::Layout);
    }
    assert_eq!(fail("TRIANGLES", "NONE", 4, 2), MeshoptError::Layout);
    assert_eq!(fail("INDICES", "NONE", 4, 1), MeshoptError::Layout);
    assert_eq!(fail("INDICES", "NONE", 4, 2), MeshoptError::Version);
}
