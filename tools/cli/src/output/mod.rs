//! What people and programs read: tables, numbers, plots, the report page.

pub(crate) mod csv;
pub(crate) mod frames;
pub(crate) mod latency;
pub(crate) mod number;
pub(crate) mod plot;
pub(crate) mod report;
pub(crate) mod spread;
pub(crate) mod stages;
pub(crate) mod table;
pub(crate) mod target;
