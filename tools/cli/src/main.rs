//! The `psao` command: record, replay, inspect, reconstruct and verify streams of point-based ambient occlusion.
//!
//! This crate is the edge: files, sockets, clocks and the terminal are here; everything else is in the libraries.

mod analysis;
mod args;
mod budget;
mod cache;
mod cli;
mod commands;
mod context;
mod edit_script;
mod error;
mod input;
mod network;
mod output;
mod pace;
mod pictures;
mod producer;
mod quantity;

use std::process::ExitCode;

fn main() -> ExitCode {
    let (arguments, note) = commands::renamed::current(std::env::args_os().collect());
    if let Some(note) = note {
        eprintln!("{note}");
    }
    match cli::run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("psao: {failure}");
            ExitCode::from(failure.exit as u8)
        }
    }
}
