//! The `psao` command: record, replay, inspect, reconstruct and verify streams of point-based ambient occlusion.
//!
//! This crate is the edge: files, sockets, clocks and the terminal are here; everything else is in the libraries.

mod analysis;
mod args;
mod budget;
mod cache;
mod commands;
mod context;
mod edit_script;
mod error;
mod network;
mod output;
mod pace;
mod pictures;
mod producer;
mod quantity;
mod recorder;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Point-based split rendering of ambient occlusion: streams recorded, replayed, inspected and drawn
///
/// Exit codes: 0 done; 1 the system failed; 2 wrong usage; 3 input refused; 4 finished, but damaged input was left
/// out; 5 the network or the peer failed; 6 a check failed.
#[derive(Parser)]
#[command(version, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    Scenes(commands::scenes::Args),
    Record(commands::record::Args),
    Keys(commands::keys::Args),
    Serve(commands::serve::Args),
    Client(commands::client::Args),
    Replay(commands::replay::Args),
    Inspect(commands::inspect::Args),
    Reconstruct(commands::reconstruct::Args),
    Verify(commands::verify::Args),
    Cut(commands::cut::Args),
    Cat(commands::cat::Args),
    Recover(commands::recover::Args),
    Lab(commands::lab::Args),
}

fn main() -> ExitCode {
    let (arguments, note) = commands::renamed::current(std::env::args_os().collect());
    if let Some(note) = note {
        eprintln!("{note}");
    }
    let result = match Cli::parse_from(arguments).command {
        Command::Demo(args) => commands::demo::run(&args),
        Command::Scenes(args) => commands::scenes::run(&args),
        Command::Record(args) => commands::record::run(&args),
        Command::Keys(args) => commands::keys::run(&args),
        Command::Serve(args) => commands::serve::run(&args),
        Command::Client(args) => commands::client::run(&args),
        Command::Replay(args) => commands::replay::run(&args),
        Command::Inspect(args) => commands::inspect::run(&args),
        Command::Reconstruct(args) => commands::reconstruct::run(&args),
        Command::Verify(args) => commands::verify::run(&args),
        Command::Cut(args) => commands::cut::run(&args),
        Command::Cat(args) => commands::cat::run(&args),
        Command::Recover(args) => commands::recover::run(&args),
        Command::Lab(args) => commands::lab::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("psao: {failure}");
            ExitCode::from(failure.exit as u8)
        }
    }
}
