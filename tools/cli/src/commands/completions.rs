//! `psao completions`: completion scripts for shells.

use std::path::Path;

use clap_complete::Shell;

use crate::error::Outcome;
use crate::output::target;

/// Print a script that completes commands and options in a shell
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao completions bash > ~/.local/share/bash-completion/completions/psao
  psao completions zsh > ~/.zfunc/_psao")]
pub(crate) struct Args {
    /// The shell to make the script for
    #[arg(value_enum)]
    shell: Shell,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut crate::cli::definition(), "psao", &mut script);
    target::write(Path::new("-"), &script)
}
