//! The adaptive range coder of profile `surface`: binary decisions, each with a probability that both sides learn.
//!
//! Everything is integer arithmetic, so encoder and decoder agree on any machine; `docs/spec/codec.md`, "Range
//! coder", has the same words and the tables. A model walks its data once, in one function for both directions: it
//! hands every decision to a [`BinaryCoder`], which writes it or reads it.

mod bit_model;
mod coder;
mod mixer;
mod number;

pub(crate) use bit_model::BitModel;
pub(crate) use coder::{BinaryCoder, LengthMismatch, RangeDecoder, RangeEncoder, SymbolClass};
pub(crate) use mixer::{Logistic, MAX_WEIGHT, Mixer, logistic};
pub(crate) use number::NumberModel;
