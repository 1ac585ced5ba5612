//! The adaptive range coder of profile `surface`: binary decisions, each with a probability that both ends learn.
//!
//! Everything is integer arithmetic, so encoder and decoder agree on every machine. `docs/spec/codec.md`, "Range
//! coder", uses the same words and has the tables.
//!
//! A model walks its data in one function for both directions. It passes every decision to a [`BinaryCoder`], which
//! writes or reads it. In these functions `source` is the data that an encoder writes, and `coded` what both ends have
//! afterwards. A decoder passes an empty `source`, which nobody reads.

mod bit_model;
mod coder;
mod mixer;
mod number;

pub(crate) use bit_model::BitModel;
pub(crate) use coder::{BinaryCoder, LengthMismatch, RangeDecoder, RangeEncoder, SymbolClass};
pub(crate) use mixer::{Logistic, MAX_WEIGHT, Mixer, logistic};
pub(crate) use number::NumberModel;
