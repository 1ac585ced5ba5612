//! The `psao` command.

fn main() {}
