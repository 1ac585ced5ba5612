//! Mode 1: indices of triangle lists, by the edges and vertices of the triangles before.

use super::indices::{push, unzigzag, varint};
use super::{Layout, MeshoptError};

const HEADER: u8 = 0xe1;
/// The table of pairs at the end of the data.
const TABLE_BYTES: usize = 16;

/// Unpacks `count / 3` triangles of indices of 2 or 4 bytes.
pub(super) fn decode(layout: Layout, bytes: &[u8]) -> Result<Vec<u8>, MeshoptError> {
    let (header, rest) = bytes.split_first().ok_or(MeshoptError::End)?;
    if *header != HEADER {
        return Err(MeshoptError::Version);
    }
    let (codes, rest) = rest.split_at_checked(layout.count / 3).ok_or(MeshoptError::End)?;
    let (data, table) = rest.split_last_chunk::<TABLE_BYTES>().ok_or(MeshoptError::End)?;
    if table[14..] != [0, 0] || table.iter().any(|pair| pair >> 4 == 15 || pair & 15 == 15) {
        return Err(MeshoptError::Code);
    }
    let mut decoder = TriangleDecoder { data, table, next: 0, last: 0, ..TriangleDecoder::default() };
    let mut out = Vec::new();
    for &code in codes {
        for index in decoder.triangle(code)? {
            push(&mut out, index, layout.stride);
        }
    }
    if decoder.data.is_empty() { Ok(out) } else { Err(MeshoptError::Rest) }
}

#[derive(Default)]
struct TriangleDecoder<'a> {
    data: &'a [u8],
    table: &'a [u8],
    /// The next index that no triangle has used.
    next: u32,
    /// The last index that was stored as a difference.
    last: u32,
    edges: Recent<[u32; 2]>,
    vertices: Recent<u32>,
}

impl TriangleDecoder<'_> {
    fn triangle(&mut self, code: u8) -> Result<[u32; 3], MeshoptError> {
        let (edge, vertex) = (code >> 4, code & 15);
        match (edge, vertex) {
            (15, 0..=13) => {
                let pair = *self.table.get(usize::from(vertex)).ok_or(MeshoptError::Code)?;
                let a = self.fresh();
                self.corners(a, pair)
            }
            (15, _) => {
                let (pair, rest) = self.data.split_first().ok_or(MeshoptError::End)?;
                self.data = rest;
                if *pair == 0 {
                    self.next = 0;
                }
                let a = if vertex == 14 { self.fresh() } else { self.stored()? };
                self.corners(a, *pair)
            }
            _ => self.beside_an_edge(edge, vertex),
        }
    }

    /// Decodes a triangle that shares a recent edge.
    fn beside_an_edge(&mut self, edge: u8, vertex: u8) -> Result<[u32; 3], MeshoptError> {
        let [a, b] = self.edges.get(edge)?;
        let c = match vertex {
            0 => self.fresh(),
            13 => self.step(u32::MAX),
            14 => self.step(1),
            15 => self.stored()?,
            recent => self.vertices.get(recent)?,
        };
        if matches!(vertex, 0 | 13..) {
            self.vertices.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// Decodes the second and the third corner of a triangle, each in one half of a byte.
    fn corners(&mut self, a: u32, pair: u8) -> Result<[u32; 3], MeshoptError> {
        let b = self.corner(pair >> 4)?;
        let c = self.corner(pair & 15)?;
        self.vertices.push(a);
        for (half, corner) in [(pair >> 4, b), (pair & 15, c)] {
            if matches!(half, 0 | 15) {
                self.vertices.push(corner);
            }
        }
        self.edges.push([b, a]);
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    fn corner(&mut self, half: u8) -> Result<u32, MeshoptError> {
        match half {
            0 => Ok(self.fresh()),
            15 => self.stored(),
            recent => self.vertices.get(recent - 1),
        }
    }

    fn fresh(&mut self) -> u32 {
        let index = self.next;
        self.next = self.next.wrapping_add(1);
        index
    }

    fn stored(&mut self) -> Result<u32, MeshoptError> {
        let code = varint(&mut self.data)?;
        Ok(self.step(unzigzag(code)))
    }

    fn step(&mut self, difference: u32) -> u32 {
        self.last = self.last.wrapping_add(difference);
        self.last
    }
}

/// The last 16 entries of a queue.
#[derive(Default)]
struct Recent<T> {
    entries: [Option<T>; 16],
    pushed: usize,
}

impl<T: Copy> Recent<T> {
    fn push(&mut self, entry: T) {
        self.entries[self.pushed % 16] = Some(entry);
        self.pushed += 1;
    }

    /// Returns the entry that was pushed `back` entries before the last one.
    fn get(&self, back: u8) -> Result<T, MeshoptError> {
        let at = self.pushed.checked_sub(usize::from(back) + 1).ok_or(MeshoptError::Code)?;
        self.entries[at % 16].ok_or(MeshoptError::Code)
    }
}
