//! `psao bench`: how fast parts of the server are on this machine, beside plain ways to do the same.

mod rays;

use crate::error::Outcome;

/// How fast parts of the server are on this machine, beside a plain way to do the same, and whether both agree
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    Rays(rays::Args),
}

pub(crate) fn run(args: &Args) -> Outcome {
    match &args.what {
        What::Rays(args) => rays::run(args),
    }
}
