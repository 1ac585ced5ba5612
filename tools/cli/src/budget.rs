//! Byte budgets: the options that set one, and what came of it.

use std::str::FromStr;

use clap::Args;
use psao_codec::surface;
use psao_proto::HEADER_BYTES;
use psao_proto::message::Budget;
use serde::Serialize;

use crate::args::STREAM;
use crate::error::{Failure, Outcome};
use crate::output::number;
use crate::quantity::{Rate, Size};

/// `--budget` and `--longest-age`.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct BudgetArgs {
    /// Size limit of a frame, for profile surface: bytes of its body (1200B, 4kB) or a rate of the stream (500kbit/s).
    /// Points that do not fit are sent later, by difference, screen size and waiting time. Keyframes have no limit
    #[arg(long, value_name = "SIZE|RATE", help_heading = STREAM)]
    budget: Option<BudgetArg>,
    #[command(flatten)]
    age: AgeArg,
}

/// `--longest-age`.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct AgeArg {
    /// Frames that a point may wait for room in the budget; then it is sent even beyond the budget
    #[arg(long, value_name = "FRAMES", default_value_t = surface::Budget::LONGEST_AGE, help_heading = STREAM)]
    pub(crate) longest_age: u16,
}

impl BudgetArgs {
    /// Returns the budget of a frame at `fps` frames per second.
    pub(crate) fn budget(&self, fps: f32) -> Outcome<Option<surface::Budget>> {
        let Some(asked) = self.budget else { return Ok(None) };
        let bytes = match asked {
            BudgetArg::Bytes(bytes) => bytes,
            BudgetArg::BitsPerSecond(rate) => {
                let frame = rate / 8.0 / f64::from(fps) - HEADER_BYTES as f64;
                if !(1.0..=f64::from(u32::MAX)).contains(&frame) {
                    return Err(Failure::usage(format_args!(
                        "a budget of {rate} bit/s at {fps} frames a second is {frame:.0} B for each, beside {HEADER_BYTES} B \
                         of wire frame: no such frame can be"
                    )));
                }
                frame as u32
            }
        };
        Ok(Some(surface::Budget::new(bytes).with_longest_age(self.age.longest_age)))
    }
}

/// Bytes of a frame body, or bits a second of wire frames.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BudgetArg {
    Bytes(u32),
    BitsPerSecond(f64),
}

impl FromStr for BudgetArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Ok(rate) = text.parse::<Rate>() {
            return Ok(Self::BitsPerSecond(rate.bits));
        }
        match text.parse::<Size>() {
            Ok(Size(bytes)) if bytes > 0 => u32::try_from(bytes)
                .map(Self::Bytes)
                .map_err(|_| format!("\"{text}\" is more than 4GiB a frame")),
            _ => Err(format!(
                "\"{text}\" is not a size such as 1200B or 4kB, or a rate such as 500kbit/s or 2Mbit/s"
            )),
        }
    }
}

/// What a server did with its budget, over the frames that it said so of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct BudgetTotals {
    pub(crate) frames: u64,
    /// The newest budget.
    pub(crate) bytes: u32,
    /// Frames that took more, for points that had waited for the longest age.
    pub(crate) over: u64,
    /// Sum over the frames of the points left for later.
    pub(crate) postponed: u64,
    /// The most of one frame.
    pub(crate) most_postponed: u32,
    /// Frames that some point has waited at most.
    pub(crate) oldest: u32,
    pub(crate) forced: u64,
}

impl BudgetTotals {
    /// Adds a frame.
    pub(crate) fn add(&mut self, frame: &Budget) {
        self.frames += 1;
        self.bytes = frame.budget;
        self.over += u64::from(frame.used > frame.budget && frame.forced > 0);
        self.postponed += u64::from(frame.postponed);
        self.most_postponed = self.most_postponed.max(frame.postponed);
        self.oldest = self.oldest.max(frame.oldest);
        self.forced += u64::from(frame.forced);
    }

    /// Returns the sums in words; `None` where no frame had a budget.
    pub(crate) fn text(&self) -> Option<String> {
        let frames = self.frames.checked_sub(1)? + 1;
        Some(format!(
            "Budget of {} B a frame: {:.1} points postponed a frame, at most {}, for {} frames at most; {} sent because they had \
             waited long enough, which took {:.1} % of the frames over it",
            number::count(self.bytes.into()),
            self.postponed as f64 / frames as f64,
            number::count(self.most_postponed.into()),
            self.oldest,
            number::count(self.forced),
            self.over as f64 * 100.0 / frames as f64,
        ))
    }
}

#[cfg(test)]
mod tests {
    use psao_proto::FrameIndex;

    use super::*;

    fn budget(text: &str, fps: f32) -> Option<u32> {
        let age = AgeArg { longest_age: 7 };
        let budget = BudgetArgs { budget: Some(text.parse().ok()?), age }.budget(fps).ok()??;
        assert_eq!(budget.longest_age, 7);
        Some(budget.bytes)
    }

    #[test]
    fn budgets_are_bytes_or_rates() {
        assert_eq!(budget("1200B", 60.0), Some(1200));
        assert_eq!(budget("1.5kB", 60.0), Some(1500));
        let envelope = HEADER_BYTES as u32;
        assert_eq!(budget("480kbit/s", 60.0), Some(1000 - envelope));
        assert_eq!(budget("0.48 Mbit/s", 30.0), Some(2000 - envelope));
        assert_eq!(budget("480000bit/s", 60.0), Some(1000 - envelope));
        assert_eq!(budget("480kbit", 60.0), Some(1000 - envelope));
        for bad in ["", "B", "12", "0B", "-5B", "xB", "nanB", "1e99B", "500kb/s", "1bit/s", "8bit/s", "5GiB"]
        {
            assert_eq!(budget(bad, 60.0), None, "{bad}");
        }
    }

    #[test]
    fn totals_count_what_was_left() {
        let mut totals = BudgetTotals::default();
        assert_eq!(totals.text(), None);
        let frame = |used, postponed, oldest, forced| Budget {
            frame: FrameIndex(0),
            budget: 1000,
            used,
            postponed,
            oldest,
            forced,
        };
        // A keyframe, one that keeps it, one that does not.
        [frame(9000, 0, 0, 0), frame(990, 30, 4, 2), frame(1001, 10, 5, 50)]
            .iter()
            .for_each(|one| totals.add(one));
        let expected = BudgetTotals {
            frames: 3,
            bytes: 1000,
            over: 1,
            postponed: 40,
            most_postponed: 30,
            oldest: 5,
            forced: 52,
        };
        assert_eq!(totals, expected);
        let text = totals.text().unwrap_or_default();
        assert!(
            text.contains("1,000 B") && text.contains("13.3 points") && text.contains("33.3 %"),
            "{text}"
        );
    }
}
