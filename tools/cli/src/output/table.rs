//! Tables for people: the first column reads from the left, figures line up at the right.

use comfy_table::{CellAlignment, LineStyle, Row, Table, presets};

/// A table under construction.
pub(crate) struct Figures {
    table: Table,
}

impl Figures {
    /// A table with these column heads.
    pub(crate) fn new<const N: usize>(heads: [&str; N]) -> Self {
        Self::of(&heads.map(str::to_owned))
    }

    /// As [`new`](Self::new), for heads that are not known beforehand.
    pub(crate) fn of(heads: &[String]) -> Self {
        let mut table = Table::new();
        table.load_style(presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none()));
        table.set_header(heads);
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        Self { table }
    }

    /// Aligns columns that hold words to the left.
    pub(crate) fn words(mut self, columns: &[usize]) -> Self {
        for &index in columns {
            if let Some(column) = self.table.column_mut(index) {
                column.set_cell_alignment(CellAlignment::Left);
            }
        }
        self
    }

    /// Adds a row.
    pub(crate) fn row<I: IntoIterator<Item = String>>(&mut self, cells: I) {
        self.table.add_row(Row::from(cells.into_iter().collect::<Vec<_>>()));
    }
}

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.table.fmt(f)
    }
}
