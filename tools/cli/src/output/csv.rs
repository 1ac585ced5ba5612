//! Rows for spreadsheets, on standard output.

use std::io::{Error, StdoutLock};

use crate::context::broken_output;
use crate::error::Outcome;

/// A CSV table being printed. Cells that need quotes get them.
pub(crate) struct Csv(csv::Writer<StdoutLock<'static>>);

impl Csv {
    /// Prints the line of heads.
    pub(crate) fn new<'a>(heads: impl IntoIterator<Item = &'a str>) -> Outcome<Self> {
        let mut csv = Self(csv::Writer::from_writer(std::io::stdout().lock()));
        csv.row(heads)?;
        Ok(csv)
    }

    /// Prints a row; it has as many cells as there are heads.
    pub(crate) fn row<T: AsRef<[u8]>>(&mut self, cells: impl IntoIterator<Item = T>) -> Outcome {
        self.0.write_record(cells).map_err(|error| broken_output(&Error::from(error)))
    }

    /// Brings everything to standard output.
    pub(crate) fn finish(mut self) -> Outcome {
        self.0.flush().map_err(|error| broken_output(&error))
    }
}
