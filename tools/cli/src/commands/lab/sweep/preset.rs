//! Tables and figures of papers: what they sweep, and what they show.

use clap::ValueEnum;
use psao_eval::sweep::{RecordAtRadius, ReferenceRays, TEXTURE_SPACE};

use super::{AxisArgs, far_field, psao, pyramid};
use crate::args::Coder;
use crate::output::table::Figures;

/// `--table`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum TableArg {
    /// Table 1 of the PSAO paper: its four densities at 60 Hz, texture space, and screen-space methods
    PsaoTable1,
    /// Figure 5 of the PSAO paper: three densities and texture space at 5, 15, 30 and 60 Hz
    PsaoFig5,
    /// Timonen 2013, figure 7 and tables 1 to 4: far-field obscurance against rays through the depth buffer
    FarField,
    /// Astapov et al. 2021, table 1 and figure 8: pyramid HBAO, HBAO and scalable AO as the radius grows
    PyramidHbao,
}

impl TableArg {
    /// What is swept unless it is given.
    pub(super) fn axes(self) -> AxisArgs {
        let fps = if self == Self::PsaoFig5 { vec![5.0, 15.0, 30.0, 60.0] } else { vec![60.0] };
        let usual = AxisArgs::usual();
        let points =
            if self == Self::PsaoTable1 { vec![512.0, 1024.0, 1536.0, 2048.0] } else { usual.points.clone() };
        AxisArgs {
            points,
            bits: vec![32],
            threshold: vec![8],
            rays: vec![192],
            coder: vec![Coder::RANGE],
            fps,
            ..usual
        }
    }

    /// Returns whether streams are part of it.
    pub(super) fn has_streams(self) -> bool {
        matches!(self, Self::PsaoTable1 | Self::PsaoFig5)
    }

    /// Returns the methods that are compared by default; `None` for all.
    pub(super) fn methods(self) -> Option<&'static [&'static str]> {
        match self {
            Self::PsaoTable1 => Some(&[TEXTURE_SPACE, "ssao", "ssao-plus", "hbao"]),
            Self::PsaoFig5 => Some(&[TEXTURE_SPACE]),
            Self::FarField | Self::PyramidHbao => None,
        }
    }

    /// Returns the radii that are swept by default; `None` for the scene's own.
    pub(super) fn radii_m(self) -> Option<&'static [f32]> {
        match self {
            // At a scene's own radius hardly anything is beyond the nearest intervals.
            Self::FarField => Some(&[3.0]),
            Self::PyramidHbao => Some(&pyramid::RADII_M),
            Self::PsaoTable1 | Self::PsaoFig5 => None,
        }
    }

    /// Returns whether one table shows all radii of a scene.
    pub(super) fn spans_radii(self) -> bool {
        self == Self::PyramidHbao
    }

    /// Returns the table of a scene, in the paper's columns.
    pub(super) fn figures(self, entries: &[RecordAtRadius<'_>], truth: &ReferenceRays) -> Figures {
        let records = || entries.iter().map(|entry| entry.record).collect();
        match self {
            Self::FarField => far_field::figures(records(), truth),
            Self::PyramidHbao => pyramid::figures(entries),
            Self::PsaoTable1 | Self::PsaoFig5 => psao::figures(records()),
        }
    }

    /// Returns the text under the table: how it compares with the paper.
    pub(super) fn beside(self, entries: &[RecordAtRadius<'_>]) -> Option<String> {
        match self {
            Self::PyramidHbao => Some(pyramid::growth(entries)),
            Self::PsaoTable1 => Some(psao::published()),
            Self::FarField | Self::PsaoFig5 => None,
        }
    }
}
