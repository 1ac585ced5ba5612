//! CONTEXT sections: the coder context of a keyframe in the middle of a group.

use super::{ByteReader, ReferenceError, rule};
use crate::surface::{BLOCK_POINTS, History, State};
use crate::wire::words;

/// Reads the plain layout of a CONTEXT section into `next`.
pub(super) fn read(next: &mut State, raw: &[u8]) -> Result<(), ReferenceError> {
    let padded = next.present.len() * BLOCK_POINTS;
    let mut bytes = ByteReader(raw);
    let age = bytes.take(padded)?.to_vec();
    let period = bytes.take(padded)?.to_vec();
    let last: Vec<i8> = bytes.take(padded)?.iter().map(|last| *last as i8).collect();
    let activity = bytes.take(padded)?.to_vec();
    rule(!last.contains(&-128))?;
    next.history = History::from_parts(age, period, last, activity);
    let mut learned = Vec::new();
    for fresh in next.model.words() {
        let [word] = words(bytes.take(4)?);
        learned.push(fresh ^ word);
    }
    bytes.end()?;
    next.model.set_words(learned.into_iter()).map_err(|_| ReferenceError::Rule)
}
