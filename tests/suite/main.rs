//! Suites that run across the crates.
#![expect(clippy::unwrap_used, reason = "a test says what it expected by panicking")]

mod fuzz_corpus;
mod networks;
mod streams;
mod vectors;
mod wire;
