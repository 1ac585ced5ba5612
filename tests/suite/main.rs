//! Suites that run across the crates.
