//! Mode 0: elements of any kind, as differences to the element before, byte by byte.

use super::{Layout, MeshoptError};

/// Elements that share a header of two bits.
const GROUP: usize = 16;
/// Bytes of a block, unpacked.
const BLOCK_BYTES: usize = 8_192;
/// Most elements of a block.
const BLOCK_ELEMENTS: usize = 256;

/// Number of bits of each difference in a group. `Bits(8)` stores whole bytes, `Bits(0)` stores nothing.
type Bits = u8;

/// Unpacks `count` elements of `stride` bytes.
pub(super) fn decode(layout: Layout, bytes: &[u8]) -> Result<Vec<u8>, MeshoptError> {
    let Layout { count, stride } = layout;
    let (header, rest) = bytes.split_first().ok_or(MeshoptError::End)?;
    let (tail_bytes, least) = match header {
        0xa0 => (stride, 32),
        0xa1 => (stride + stride / 4, 24),
        _ => return Err(MeshoptError::Version),
    };
    let end = rest.len().checked_sub(tail_bytes.max(least)).ok_or(MeshoptError::End)?;
    let tail = &rest[rest.len() - tail_bytes..];
    let (baseline, channels) = tail.split_at(stride);
    let channels = channels.iter().map(|code| Channel::new(*code)).collect::<Result<Vec<_>, _>>()?;
    let mut data = &rest[..end];
    let mut last = baseline.to_vec();
    let most = ((BLOCK_BYTES / stride) & !(GROUP - 1)).min(BLOCK_ELEMENTS);
    let mut out = Vec::new();
    let mut left = count;
    while left > 0 {
        let elements = left.min(most);
        let differences = block(&mut data, elements, stride, *header == 0xa1)?;
        for element in 0..elements {
            for channel in 0..stride / 4 {
                let at = |k: usize| (channel * 4 + k) * most + element;
                let step = [0, 1, 2, 3].map(|k| differences[at(k)]);
                let bytes = &mut last[channel * 4..channel * 4 + 4];
                let before = [bytes[0], bytes[1], bytes[2], bytes[3]];
                let kind = channels.get(channel).copied().unwrap_or(Channel::Bytes);
                bytes.copy_from_slice(&kind.add(before, step));
            }
            out.extend_from_slice(&last);
        }
        left -= elements;
    }
    if data.is_empty() { Ok(out) } else { Err(MeshoptError::Rest) }
}

/// The way in which the four bytes of a channel differ from those before.
#[derive(Clone, Copy)]
enum Channel {
    /// Zigzag differences of bytes.
    Bytes,
    /// Zigzag differences of 16-bit words.
    Words,
    /// Bits that differ. The encoder turned them left by a number of bits.
    Xor(u32),
}

impl Channel {
    fn new(code: u8) -> Result<Self, MeshoptError> {
        match (code & 15, code >> 4) {
            (0, 0) => Ok(Self::Bytes),
            (1, 0) => Ok(Self::Words),
            (2, turn) => Ok(Self::Xor(u32::from(turn))),
            _ => Err(MeshoptError::Code),
        }
    }

    /// Returns four bytes from those before and their stored differences.
    fn add(self, before: [u8; 4], step: [u8; 4]) -> [u8; 4] {
        match self {
            Self::Bytes => {
                let unzigzag = |code: u8| if code & 1 == 0 { code >> 1 } else { !(code >> 1) };
                [0, 1, 2, 3].map(|k| before[k].wrapping_add(unzigzag(step[k])))
            }
            Self::Words => {
                let unzigzag = |code: u16| if code & 1 == 0 { code >> 1 } else { !(code >> 1) };
                let word = |k: usize| {
                    let [old, code] =
                        [before, step].map(|bytes| u16::from_le_bytes([bytes[k], bytes[k + 1]]));
                    old.wrapping_add(unzigzag(code)).to_le_bytes()
                };
                let ([a, b], [c, d]) = (word(0), word(2));
                [a, b, c, d]
            }
            Self::Xor(turn) => {
                let bits = u32::from_le_bytes(step).rotate_right(turn);
                (u32::from_le_bytes(before) ^ bits).to_le_bytes()
            }
        }
    }
}

/// Reads the differences of a block, byte by byte of an element. Those of each byte begin at a multiple of the largest
/// number of elements in a block.
fn block(
    data: &mut &[u8],
    elements: usize,
    stride: usize,
    controlled: bool,
) -> Result<Vec<u8>, MeshoptError> {
    let most = ((BLOCK_BYTES / stride) & !(GROUP - 1)).min(BLOCK_ELEMENTS);
    let controls = if controlled { take(data, stride / 4)? } else { &[] };
    let mut out = vec![0; stride * most];
    for (k, differences) in out.chunks_exact_mut(most).enumerate() {
        let control = controls.get(k / 4).map(|byte| byte >> (2 * (k % 4)) & 3);
        match control {
            None => groups(data, elements, [0, 2, 4, 8], differences)?,
            Some(0) => groups(data, elements, [0, 1, 2, 4], differences)?,
            Some(1) => groups(data, elements, [1, 2, 4, 8], differences)?,
            Some(2) => {}
            Some(_) => differences[..elements].copy_from_slice(take(data, elements)?),
        }
    }
    Ok(out)
}

/// Reads the differences of one byte of all elements in groups of 16. A header of two bits for each group selects the
/// number of bits of its differences.
fn groups(data: &mut &[u8], elements: usize, choices: [Bits; 4], out: &mut [u8]) -> Result<(), MeshoptError> {
    let count = elements.div_ceil(GROUP);
    let headers = take(data, count.div_ceil(4))?;
    for (g, group) in out.chunks_exact_mut(GROUP).take(count).enumerate() {
        let choice = headers[g / 4] >> (2 * (g % 4)) & 3;
        match choices[usize::from(choice)] {
            0 => group.fill(0),
            8 => group.copy_from_slice(take(data, GROUP)?),
            bits => sentinels(data, bits, group)?,
        }
    }
    Ok(())
}

/// Reads 16 differences of 1, 2 or 4 bits. One with all bits set is followed by a whole byte, after all of them.
fn sentinels(data: &mut &[u8], bits: Bits, group: &mut [u8]) -> Result<(), MeshoptError> {
    let packed = take(data, usize::from(bits) * GROUP / 8)?;
    let (per_byte, sentinel) = (8 / usize::from(bits), (1 << bits) - 1);
    for (i, slot) in group.iter_mut().enumerate() {
        let within = i % per_byte;
        // Single bits start at the lowest bit of a byte, all others at the highest.
        let place = if bits == 1 { within } else { per_byte - 1 - within };
        let value = packed[i / per_byte] >> (place * usize::from(bits)) & sentinel;
        *slot = if value == sentinel { take(data, 1)?[0] } else { value };
    }
    Ok(())
}

fn take<'a>(data: &mut &'a [u8], count: usize) -> Result<&'a [u8], MeshoptError> {
    let (taken, rest) = data.split_at_checked(count).ok_or(MeshoptError::End)?;
    *data = rest;
    Ok(taken)
}
