//! One file per command.

pub(crate) mod bench;
pub(crate) mod cat;
pub(crate) mod client;
pub(crate) mod compare_budgets;
pub(crate) mod compare_profiles;
pub(crate) mod cut;
pub(crate) mod demo;
pub(crate) mod evaluate;
pub(crate) mod inspect;
pub(crate) mod keys;
pub(crate) mod needs;
pub(crate) mod netlab;
pub(crate) mod reconstruct;
pub(crate) mod record;
pub(crate) mod recover;
pub(crate) mod replay;
pub(crate) mod scenes;
pub(crate) mod serve;
pub(crate) mod stress;
pub(crate) mod verify;
