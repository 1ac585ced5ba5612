//! The command line: verbs, their groups in `psao --help`, and what runs them.

use std::fmt::Write as _;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::commands;
use crate::error::Outcome;

/// Stream ambient occlusion (AO) from a ray tracer to thin clients
///
/// A server traces AO at points on the surfaces of an animated scene and sends only the values that changed. A client,
/// which draws the scene itself, turns them into AO for every pixel. psao makes, records, plays, inspects and checks such
/// streams.
#[derive(Parser)]
#[command(name = "psao", version, max_term_width = 110, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// Exit codes, as the README documents them.
const EXIT_CODES: &str = "Exit codes:
  0  done
  1  the system failed: disk, memory, threads
  2  wrong usage: the command line is wrong for any input
  3  refused: a scene, recording or file, or an option that does not fit it
  4  done, but damaged input was left out
  5  the network or the other side failed
  6  a check failed: a hash, a bound, a verdict";

#[derive(Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    Scenes(commands::scenes::Args),
    Keys(commands::keys::Args),
    Record(commands::record::Args),
    Serve(commands::serve::Args),
    Replay(commands::replay::Args),
    Client(commands::client::Args),
    Inspect(commands::inspect::Args),
    Reconstruct(commands::reconstruct::Args),
    Verify(commands::verify::Args),
    Cut(commands::cut::Args),
    Cat(commands::cat::Args),
    Recover(commands::recover::Args),
    Lab(commands::lab::Args),
    Completions(commands::completions::Args),
    Man(commands::man::Args),
}

/// Headings of `psao --help`, each with its commands.
const GROUPS: [(&str, &[&str]); 6] = [
    ("First steps", &["demo", "scenes", "keys"]),
    ("Make and play streams", &["record", "serve", "replay", "client"]),
    ("Look into recordings", &["inspect", "reconstruct", "verify"]),
    ("Edit recordings", &["cut", "cat", "recover"]),
    ("Experiments", &["lab"]),
    ("About this command", &["completions", "man", "help"]),
];

/// Returns the definition of the whole command line.
pub(crate) fn definition() -> clap::Command {
    let mut command = Cli::command();
    // `help` is added when the command is built.
    let about = |command: &clap::Command, name: &str| match command.find_subcommand(name) {
        Some(found) => found.get_about().map(ToString::to_string).unwrap_or_default(),
        None => "Print this list, or the options of a command".to_owned(),
    };
    let mut template = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    let heading = *command.get_styles().get_header();
    let literal = *command.get_styles().get_literal();
    for (title, names) in GROUPS {
        let _ = write!(template, "\n{heading}{title}:{heading:#}\n");
        for name in names {
            let _ = writeln!(template, "  {literal}{name:<12}{literal:#}{}", about(&command, name));
        }
    }
    let _ = write!(template, "\n{heading}Options:{heading:#}\n{{options}}{{after-help}}");
    command = command.help_template(template);
    command
}

/// Runs what `arguments` ask for.
pub(crate) fn run(arguments: Vec<std::ffi::OsString>) -> Outcome {
    let matches = definition().get_matches_from(arguments);
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    match cli.command {
        Command::Demo(args) => commands::demo::run(&args),
        Command::Scenes(args) => commands::scenes::run(&args),
        Command::Keys(args) => commands::keys::run(&args),
        Command::Record(args) => commands::record::run(&args),
        Command::Serve(args) => commands::serve::run(&args),
        Command::Replay(args) => commands::replay::run(&args),
        Command::Client(args) => commands::client::run(&args),
        Command::Inspect(args) => commands::inspect::run(&args),
        Command::Reconstruct(args) => commands::reconstruct::run(&args),
        Command::Verify(args) => commands::verify::run(&args),
        Command::Cut(args) => commands::cut::run(&args),
        Command::Cat(args) => commands::cat::run(&args),
        Command::Recover(args) => commands::recover::run(&args),
        Command::Lab(args) => commands::lab::run(&args),
        Command::Completions(args) => commands::completions::run(&args),
        Command::Man(args) => commands::man::run(&args),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_holds_and_every_command_has_one_heading() {
        let command = definition();
        command.clone().debug_assert();
        let grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        for subcommand in command.get_subcommands() {
            let name = subcommand.get_name();
            assert_eq!(grouped.iter().filter(|grouped| **grouped == name).count(), 1, "{name}");
        }
        assert_eq!(grouped.len(), command.get_subcommands().count() + 1, "all, and help");
    }

    #[test]
    fn the_examples_of_the_help_are_command_lines() {
        fn check(command: &clap::Command) {
            let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            for line in examples.lines().filter(|line| line.starts_with("  psao ")) {
                for part in line.split(" | ").filter(|part| part.trim_start().starts_with("psao ")) {
                    let typed = part.split(" > ").next().unwrap_or_default();
                    let parsed = definition().try_get_matches_from(shlex::split(typed).unwrap());
                    assert!(parsed.is_ok(), "{typed}: {}", parsed.unwrap_err());
                }
            }
            command.get_subcommands().for_each(check);
        }
        check(&definition());
    }

    #[test]
    fn every_command_says_what_it_does_in_a_line_and_gives_examples() {
        fn check(command: &clap::Command, path: &str) {
            for subcommand in command.get_subcommands() {
                let path = format!("{path} {}", subcommand.get_name());
                let about = subcommand.get_about().unwrap_or_else(|| panic!("{path}")).to_string();
                assert!(about.len() <= 66 && !about.contains('\n'), "{path}: {about}");
                if subcommand.has_subcommands() {
                    check(subcommand, &path);
                } else {
                    let examples = subcommand.get_after_help().map(ToString::to_string).unwrap_or_default();
                    assert!(examples.contains(&path), "{path}: {examples}");
                }
                for option in subcommand.get_arguments().filter(|option| !option.is_hide_set()) {
                    assert!(option.get_help().is_some(), "{path} {}", option.get_id());
                }
            }
        }
        check(&definition(), "psao");
    }
}
