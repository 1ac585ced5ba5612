//! CONTEXT sections: history and change model, for a keyframe in the middle of a group. A client that joins with it
//! can decode the same updates as all others.
//!
//! The plain layout has four planes of one byte for every padded index: age, period, last (signed) and activity. Then
//! follows every bit model and weight of the change model as u32, in the order of [`ChangeModel::words`]. Each is the
//! exclusive or with that of a fresh model.

use super::change::ChangeModel;
use super::history::History;
use crate::wire::{push_words, words};

/// Why a context was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ContextError {
    /// Its length differs from that of the layout.
    #[error("it has {found} B, the layout asks for {expected} B")]
    Length {
        /// Length by the layout, bytes.
        expected: usize,
        /// Found, bytes.
        found: usize,
    },
    /// The last level of a point is -128, outside -127 to 127.
    #[error("the last level at padded index {padded_index} is -128; the lowest is -127")]
    Last {
        /// The padded index of the point.
        padded_index: usize,
    },
    /// A word that no model has.
    #[error("word {word} of the model is {found:#010x}, which no model has")]
    Model {
        /// Index of the word.
        word: usize,
        /// Found.
        found: u32,
    },
}

/// Returns the length of the plain layout for `padded_count` padded indices, in bytes.
pub(crate) fn plain_bytes(padded_count: usize) -> usize {
    4 * padded_count + 4 * ChangeModel::new().words().len()
}

/// Appends the plain layout to `out`.
pub(crate) fn write(history: &History, model: &ChangeModel, out: &mut Vec<u8>) {
    out.extend_from_slice(&history.age);
    out.extend_from_slice(&history.period);
    out.extend(history.last.iter().map(|last| *last as u8));
    out.extend_from_slice(&history.activity);
    for (word, fresh) in model.words().into_iter().zip(ChangeModel::new().words()) {
        push_words(out, &[word ^ fresh]);
    }
}

/// Reads the plain layout into `history` and `model`. Their content is unspecified after an error.
pub(crate) fn read(raw: &[u8], history: &mut History, model: &mut ChangeModel) -> Result<(), ContextError> {
    let padded_count = history.age.len();
    let (expected, found) = (plain_bytes(padded_count), raw.len());
    if expected != found {
        return Err(ContextError::Length { expected, found });
    }
    let plane = |number: usize| &raw[number * padded_count..(number + 1) * padded_count];
    if let Some(padded_index) = plane(2).iter().position(|last| *last == 0x80) {
        return Err(ContextError::Last { padded_index });
    }
    let last = plane(2).iter().map(|last| *last as i8).collect();
    *history = History::from_parts(plane(0).to_vec(), plane(1).to_vec(), last, plane(3).to_vec());
    let fresh = ChangeModel::new().words();
    let learned =
        raw[4 * padded_count..].chunks_exact(4).zip(fresh).map(|(bytes, fresh)| words::<1>(bytes)[0] ^ fresh);
    model.set_words(learned).map_err(|(word, found)| ContextError::Model { word, found })
}
