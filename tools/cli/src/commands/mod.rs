//! One file or folder for each command.

pub(crate) mod cat;
pub(crate) mod client;
pub(crate) mod completions;
pub(crate) mod cut;
pub(crate) mod demo;
pub(crate) mod inspect;
pub(crate) mod keys;
pub(crate) mod lab;
pub(crate) mod man;
pub(crate) mod reconstruct;
pub(crate) mod record;
pub(crate) mod recover;
pub(crate) mod renamed;
pub(crate) mod replay;
pub(crate) mod scenes;
pub(crate) mod serve;
pub(crate) mod verify;
