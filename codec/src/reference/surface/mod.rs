//! The reference of [`crate::surface::Decoder`]. It builds the whole state after a frame from the definition of the
//! format alone. With the fast path it shares only the primitives of the range coder, the readers of the wire and the
//! block coders.

mod changes;
mod context;
mod curve;
mod encoder;
mod geometry;
mod geometry_coder;
mod parents;
mod patch;
mod values;

pub use encoder::{ReferenceDelta, SurfaceReferenceEncoder};

use super::ReferenceError;
use crate::block::{CoderId, decompress};
use crate::envelope::{FrameInfo, FrameKind, Profile, SectionInfo, SectionTag, inspect};
use crate::hash::{RecordKind, term};
use crate::range::RangeDecoder;
use crate::surface::{BLOCK_POINTS, Layout, State};
use crate::wire::read_varint;
use crate::{Limits, StateHash};

/// Returns the state after a frame body of profile `surface`, computed from scratch.
///
/// # Errors
/// Refuses exactly what [`crate::surface::Decoder::apply`] refuses.
pub fn apply_surface(state: &State, body: &[u8], limits: &Limits) -> Result<State, ReferenceError> {
    let info = inspect(body, limits)?;
    let follows = match (info.kind, state.frame()) {
        (FrameKind::Key, _) => true,
        (FrameKind::Delta, last) => last.is_some_and(|last| info.frame > last),
    };
    if info.profile != Profile::SURFACE || !follows {
        return Err(ReferenceError::Rule);
    }
    let mut next = match info.kind {
        FrameKind::Key => state.empty(),
        FrameKind::Delta => state.clone(),
    };
    read_sections(state, &mut next, &info, body, limits)?;
    next.hash = full_hash(&next);
    next.frame = Some(info.frame);
    if next.hash == info.hash { Ok(next) } else { Err(ReferenceError::Hash) }
}

/// Updates `next` except for its hash.
fn read_sections(
    state: &State,
    next: &mut State,
    info: &FrameInfo,
    body: &[u8],
    limits: &Limits,
) -> Result<(), ReferenceError> {
    let mut values = values::ValueDecoder::new();
    let mut geometry = geometry_coder::GeometryDecoder::new();
    let mut changes = changes::Changes::none(state);
    let is_patch = info.sections.iter().any(|section| section.tag == SectionTag::PATCH);
    if is_patch {
        // A patch makes the coder context fresh, unless it carries one.
        let State { history, model, .. } = state.empty();
        (next.history, next.model) = (history, model);
    }
    let mut at = info.header_bytes as usize;
    for section in &info.sections {
        let end = at + section.wire_bytes as usize;
        let block = Block { section, stored: &body[at..end], limits };
        at = end;
        match section.tag {
            SectionTag::GEOMETRY => geometry::read(next, block, &mut geometry)?,
            SectionTag::VALUES => values::read(next, block, &mut values)?,
            SectionTag::CHANGES => changes = changes::read(state, block)?,
            SectionTag::PATCH => patch::read(state, next, info.frame, block)?,
            _ => {
                rule(section.records == 1)?;
                context::read(next, &block.raw()?)?;
            }
        }
    }
    if info.kind == FrameKind::Delta && !is_patch {
        changes.make(state, next);
    }
    Ok(())
}

/// A section and its block.
#[derive(Clone, Copy)]
struct Block<'a> {
    section: &'a SectionInfo,
    stored: &'a [u8],
    limits: &'a Limits,
}

impl<'a> Block<'a> {
    /// Returns the plain layout of a block that the range coder did not write.
    fn raw(&self) -> Result<Vec<u8>, ReferenceError> {
        let SectionInfo { coder, raw_bytes, .. } = *self.section;
        Ok(decompress(self.stored, coder, raw_bytes, self.limits.max_block_bytes)?)
    }

    /// Returns the decoder of a block that the range coder wrote.
    fn decoder(&self) -> Option<RangeDecoder<'a>> {
        (self.section.coder == CoderId::RANGE).then(|| RangeDecoder::new(self.stored))
    }

    /// Checks after the last decision that the block ends there and its plain layout has the announced length.
    fn end(&self, decoder: RangeDecoder<'_>, plain_bytes: usize) -> Result<(), ReferenceError> {
        rule(decoder.finish().is_ok() && plain_bytes == self.section.raw_bytes as usize)
    }
}

fn rule(kept: bool) -> Result<(), ReferenceError> {
    if kept { Ok(()) } else { Err(ReferenceError::Rule) }
}

/// A point block: 64 padded indices of an instance, of which the first `points` have a point.
#[derive(Clone, Copy, PartialEq)]
struct BlockInfo {
    instance: usize,
    /// Number of the block in its instance.
    number: usize,
    points: usize,
}

impl BlockInfo {
    /// Returns all blocks of a stream, in order.
    fn all(layout: &Layout) -> Vec<BlockInfo> {
        let mut blocks_info = Vec::new();
        for (instance, member) in layout.members().iter().enumerate() {
            let points: Vec<u32> = (0..layout.sets()[member.set as usize].points).collect();
            for (number, block) in points.chunks(BLOCK_POINTS).enumerate() {
                blocks_info.push(BlockInfo { instance, number, points: block.len() });
            }
        }
        blocks_info
    }
}

/// Returns the sum of the terms of everything received.
fn full_hash(state: &State) -> StateHash {
    let mut sum = 0_u64;
    for (set, layout) in state.layout().sets().iter().enumerate() {
        if state.received[set] {
            let digest = layout.digest.0;
            let words = [digest as u32, (digest >> 32) as u32, 1];
            sum = sum.wrapping_add(term(RecordKind::Geometry, set as u32, &words));
        }
    }
    for (block, info) in BlockInfo::all(state.layout()).into_iter().enumerate() {
        for padded in block * BLOCK_POINTS..block * BLOCK_POINTS + info.points {
            if state.present[block] {
                let words = [u32::from(state.values[padded]) + 1];
                sum = sum.wrapping_add(term(RecordKind::Value, padded as u32, &words));
            }
        }
    }
    StateHash(sum)
}

/// Reads bytes from front to back.
struct ByteReader<'a>(&'a [u8]);

impl<'a> ByteReader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], ReferenceError> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(ReferenceError::Rule)?;
        self.0 = rest;
        Ok(taken)
    }

    fn varint(&mut self) -> Result<u32, ReferenceError> {
        let (value, length) = read_varint(self.0).map_err(|_| ReferenceError::Rule)?;
        self.take(length)?;
        Ok(value)
    }

    fn end(&self) -> Result<(), ReferenceError> {
        rule(self.0.is_empty())
    }
}

/// Returns the length of a number as a varint, bytes.
fn varint_bytes(value: u32) -> usize {
    1 + [7, 14, 21, 28].into_iter().filter(|decoder| value >> decoder > 0).count()
}

/// Returns the number of significant bits.
fn significant(value: u64) -> usize {
    (0..64).filter(|decoder| value >> decoder > 0).count()
}

/// Returns the index of a context in its table, from digits with a radix each.
fn index<const N: usize>(digits: [(usize, usize); N]) -> usize {
    let mut index = 0;
    for (digit, radix) in digits {
        assert!(digit < radix, "a context of {digit} of {radix} would be taken for another");
        index = index * radix + digit;
    }
    index
}
