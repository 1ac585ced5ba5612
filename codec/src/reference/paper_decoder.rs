//! The reference of [`crate::paper::Decoder`]: it builds the whole state after a frame and then checks it.

use std::sync::Arc;

use crate::Limits;
use crate::block::{BlockError, decompress};
use crate::envelope::{FrameError, FrameKind, SectionTag, inspect};
use crate::paper::{Bucket, Cell, ENTRIES_PER_BUCKET, Layout, POINTS_PER_CELL, Pose, State};
use crate::wire::words;

/// Why the reference refused a frame; coarser than [`FrameError`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// The header is invalid.
    #[error(transparent)]
    Header(#[from] FrameError),
    /// A block is invalid.
    #[error(transparent)]
    Block(#[from] BlockError),
    /// A record or the order of frames breaks a rule.
    #[error("a record breaks a rule of the format, or the frame does not follow the state")]
    Rule,
    /// The state after the frame has another hash.
    #[error("the state after the frame has another hash")]
    Hash,
}

/// Returns the state after a frame body, computed from scratch.
///
/// # Errors
/// Refuses exactly what [`crate::paper::Decoder`] refuses.
pub fn apply(state: &State, body: &[u8], limits: &Limits) -> Result<State, ReferenceError> {
    let info = inspect(body, limits)?;
    if info.packing != state.layout().format().packing() {
        return Err(ReferenceError::Rule);
    }
    let mut next = match (info.kind, state.frame()) {
        (FrameKind::Key, _) => State::new(Arc::clone(state.layout())),
        (FrameKind::Delta, Some(last)) if info.frame > last => state.clone(),
        _ => return Err(ReferenceError::Rule),
    };
    let mut at = info.header_bytes as usize;
    for section in &info.sections {
        let end = at + section.wire_bytes as usize;
        let raw = decompress(&body[at..end], section.coder, section.raw_bytes, limits.max_block_bytes)?;
        at = end;
        let size = raw.len() / section.records as usize;
        let records: Vec<(u32, &[u8])> = raw.chunks(size).map(|r| (words::<1>(r)[0], &r[4..])).collect();
        if records.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err(ReferenceError::Rule);
        }
        for (offset, content) in records {
            write_record(&mut next, section.tag, offset as usize, content).ok_or(ReferenceError::Rule)?;
        }
    }
    next.hash = next.full_hash();
    next.frame = Some(info.frame);
    if next.hash == info.hash { Ok(next) } else { Err(ReferenceError::Hash) }
}

/// Writes one record; `None` if it breaks a rule.
fn write_record(state: &mut State, tag: SectionTag, offset: usize, content: &[u8]) -> Option<()> {
    let layout = Arc::clone(state.layout());
    match tag {
        SectionTag::POSES => {
            let pose = Pose::from_words(words(content));
            *state.poses.get_mut(offset)? = pose;
            let square: f32 = pose.rotation.iter().map(|axis| axis * axis).sum();
            let finite = pose.translation.iter().all(|axis| axis.is_finite());
            (finite && (square - 1.0).abs() <= 0.001).then_some(())
        }
        SectionTag::BUCKETS => {
            let content = words(content);
            *state.buckets.get_mut(offset)? = Bucket::from_words(&content);
            bucket_is_sound(&content, &layout).then_some(())
        }
        _ => {
            let cell = state.cells.get_mut(offset)?;
            let width = layout.format().bytes();
            let mut new: [u32; POINTS_PER_CELL] = *cell.words();
            for (at, byte) in content.iter().enumerate() {
                new[at / width] ^= u32::from(*byte) << (8 * (at % width));
            }
            *cell = Cell::from_words(new);
            let valid = 1 << (8 * width - 1);
            let used = new.iter().filter(|word| **word >= valid).count();
            let compact = (0..POINTS_PER_CELL)
                .all(|slot| if slot < used { new[slot] >= valid } else { new[slot] == 0 });
            compact.then_some(())
        }
    }
}

/// Returns whether 16 words are a bucket as an encoder writes it.
fn bucket_is_sound(content: &[u32; 2 * ENTRIES_PER_BUCKET], layout: &Layout) -> bool {
    let points = |entry: usize| (content[2 * entry + 1] >> 22) & 31;
    let used = (0..ENTRIES_PER_BUCKET).filter(|entry| points(*entry) > 0).count();
    (0..ENTRIES_PER_BUCKET).all(|entry| {
        let (id, word) = (content[2 * entry], content[2 * entry + 1]);
        if entry >= used {
            return id == 0 && word == 0;
        }
        let count = if entry == 0 { used as u32 } else { 0 };
        (1..=7).contains(&points(entry)) && word & 0x3F_FFFF < layout.cell_capacity() && word >> 27 == count
    })
}
