//! `psao man`: manual pages.

use std::path::{Path, PathBuf};

use clap_mangen::Man;

use crate::context::say;
use crate::error::{Exit, Failure, Outcome};
use crate::output::target;

/// Print the manual, or write a page for each command
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao man | man -l -
  psao man -o ~/.local/share/man/man1")]
pub(crate) struct Args {
    /// Write psao.1 and a page for each command into this folder
    #[arg(short, long, alias = "out", value_name = "FOLDER")]
    output: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let command = crate::cli::definition();
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder).map_err(|error| Failure::writing(folder, &error))?;
        clap_mangen::generate_to(command, folder).map_err(|error| Failure::writing(folder, &error))?;
        return say(format_args!("wrote the pages to {}", folder.display()));
    }
    let mut page = Vec::new();
    Man::new(command)
        .render(&mut page)
        .map_err(|error| Failure::new(Exit::System, format_args!("cannot write the manual: {error}")))?;
    target::write(Path::new("-"), &page)
}
