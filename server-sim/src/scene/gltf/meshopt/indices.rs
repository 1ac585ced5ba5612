//! Mode 2: indices of any topology, as differences to one of two earlier ones.

use super::{Layout, MeshoptError};

const HEADER: u8 = 0xd1;
const TAIL_BYTES: usize = 4;

/// Unpacks `count` indices of 2 or 4 bytes.
pub(super) fn decode(layout: Layout, bytes: &[u8]) -> Result<Vec<u8>, MeshoptError> {
    let (header, rest) = bytes.split_first().ok_or(MeshoptError::End)?;
    if *header != HEADER {
        return Err(MeshoptError::Version);
    }
    let mut data = rest.get(..rest.len().saturating_sub(TAIL_BYTES)).ok_or(MeshoptError::End)?;
    let mut last = [0_u32; 2];
    let mut out = Vec::new();
    for _ in 0..layout.count {
        let code = varint(&mut data)?;
        let base = &mut last[(code & 1) as usize];
        *base = base.wrapping_add(unzigzag(code >> 1));
        push(&mut out, *base, layout.stride);
    }
    if data.is_empty() { Ok(out) } else { Err(MeshoptError::Rest) }
}

/// Appends an index of 2 or 4 bytes.
pub(super) fn push(out: &mut Vec<u8>, index: u32, stride: usize) {
    out.extend_from_slice(&index.to_le_bytes()[..stride]);
}

/// Reads an unsigned integer of 7 bits a byte (LEB128), at most five bytes. Bits beyond the 32nd are ignored.
pub(super) fn varint(data: &mut &[u8]) -> Result<u32, MeshoptError> {
    let mut value = 0;
    for shift in (0..35).step_by(7) {
        let (byte, rest) = data.split_first().ok_or(MeshoptError::End)?;
        *data = rest;
        value |= u32::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(MeshoptError::Code)
}

/// Returns the signed difference that a zigzag code stands for, in two's complement.
pub(super) fn unzigzag(code: u32) -> u32 {
    if code & 1 == 0 { code >> 1 } else { !(code >> 1) }
}
