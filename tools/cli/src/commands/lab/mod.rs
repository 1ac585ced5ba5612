//! `psao lab`: experiments on settings, methods, networks and speed.

pub(crate) mod budgets;
pub(crate) mod needs;
pub(crate) mod network;
pub(crate) mod profiles;
pub(crate) mod rays;
pub(crate) mod stress;
pub(crate) mod sweep;

use crate::error::Outcome;

/// Measure settings, other methods, networks and speed
///
/// Each experiment prints tables for people, or JSON with a documented schema for programs.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(clap::Subcommand, Debug)]
enum Experiment {
    // Its options take several times the room of the others.
    Sweep(Box<sweep::Args>),
    Profiles(profiles::Args),
    Budgets(budgets::Args),
    Needs(needs::Args),
    Stress(stress::Args),
    Rays(rays::Args),
    Network(network::Args),
}

pub(crate) fn run(args: &Args) -> Outcome {
    match &args.experiment {
        Experiment::Sweep(args) => sweep::run(args),
        Experiment::Profiles(args) => profiles::run(args),
        Experiment::Budgets(args) => budgets::run(args),
        Experiment::Needs(args) => needs::run(args),
        Experiment::Stress(args) => stress::run(args),
        Experiment::Rays(args) => rays::run(args),
        Experiment::Network(args) => network::run(args),
    }
}
