//! The bandwidth plot: bytes of every frame, stacked by part, as a self-contained SVG.
//!
//! A keyframe can be a hundred times a delta frame. The axis therefore fits the delta frames; a bar that is
//! larger is cut at the top and carries its size in words.

use std::fmt::Write as _;

use psao_eval::report::{COLOURS, escape};

use super::number;

const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 64.0;
const BOTTOM: f64 = 44.0;

/// One bar: a frame and its bytes by part, in the order of [`Plot::parts`].
pub(crate) struct Bar {
    pub(crate) frame: u32,
    pub(crate) key: bool,
    pub(crate) bytes: Vec<u64>,
}

/// What the plot shows.
pub(crate) struct Plot {
    pub(crate) title: String,
    pub(crate) parts: Vec<String>,
    pub(crate) bars: Vec<Bar>,
    /// Frames a second, for the scale in Mbit/s at the right edge of the title.
    pub(crate) fps: f64,
}

impl Plot {
    /// Returns the whole SVG document.
    pub(crate) fn svg(&self) -> String {
        let mut out = String::new();
        let ceiling = self.ceiling();
        let _ = write!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"system-ui, sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT}\" y=\"22\" font-size=\"15\" font-weight=\"600\">{}</text>\n",
            escape(&self.title)
        );
        self.legend(&mut out);
        self.grid(&mut out, ceiling);
        self.stacks(&mut out, ceiling);
        out.push_str("</svg>\n");
        out
    }

    /// Returns the bytes at the top of the axis: the largest delta frame, or the largest frame when there is no other.
    fn ceiling(&self) -> f64 {
        let largest = |key: bool| {
            self.bars.iter().filter(|bar| bar.key == key).map(|bar| bar.bytes.iter().sum::<u64>()).max()
        };
        let top = largest(false).or_else(|| largest(true)).unwrap_or(1).max(1);
        nice_above(top as f64)
    }

    fn legend(&self, out: &mut String) {
        let mut x = LEFT;
        for (part, colour) in self.parts.iter().zip(COLOURS.iter().cycle()) {
            let _ = writeln!(
                out,
                "<rect x=\"{x:.1}\" y=\"34\" width=\"12\" height=\"12\" fill=\"{colour}\"/>\
                 <text x=\"{:.1}\" y=\"44\">{}</text>",
                x + 17.0,
                escape(part)
            );
            x += 34.0 + 7.2 * part.len() as f64;
        }
    }

    fn grid(&self, out: &mut String, ceiling: f64) {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        for step in 0..=4 {
            let value = ceiling * f64::from(step) / 4.0;
            let y = bottom - (bottom - TOP) * f64::from(step) / 4.0;
            let _ = writeln!(
                out,
                "<line x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 8.0,
                y + 4.0,
                number::bytes(value.round() as u64)
            );
        }
        let _ = writeln!(
            out,
            "<text x=\"{right}\" y=\"22\" text-anchor=\"end\" fill=\"#555555\">top of the axis = {:.2} Mbit/s \
             at {:.0} Hz</text>",
            ceiling * 8.0 * self.fps / 1e6,
            self.fps
        );
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">frame</text>",
            (LEFT + right) / 2.0,
            HEIGHT - 8.0
        );
    }

    fn stacks(&self, out: &mut String, ceiling: f64) {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let slot = (right - LEFT) / self.bars.len().max(1) as f64;
        let label_every = (self.bars.len() / 10).max(1);
        for (index, bar) in self.bars.iter().enumerate() {
            let x = LEFT + slot * index as f64;
            let mut base = bottom;
            for (part, (&bytes, colour)) in bar.bytes.iter().zip(COLOURS.iter().cycle()).enumerate() {
                let height = (bytes as f64 / ceiling * (bottom - TOP)).min(base - TOP);
                if height <= 0.0 {
                    continue;
                }
                base -= height;
                let _ = writeln!(
                    out,
                    "<rect x=\"{x:.2}\" y=\"{base:.2}\" width=\"{:.2}\" height=\"{height:.2}\" fill=\"{colour}\">\
                     <title>frame {}: {} {}</title></rect>",
                    (slot * 0.9).max(0.5),
                    bar.frame,
                    escape(self.parts.get(part).map_or("", String::as_str)),
                    number::bytes(bytes)
                );
            }
            self.marks(out, bar, ceiling, x, slot);
            if index % label_every == 0 {
                let _ = writeln!(
                    out,
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                    x + slot / 2.0,
                    bottom + 16.0,
                    bar.frame
                );
            }
        }
    }

    /// Writes the size of a bar that the axis cuts.
    fn marks(&self, out: &mut String, bar: &Bar, ceiling: f64, x: f64, slot: f64) {
        let total: u64 = bar.bytes.iter().sum();
        if total as f64 <= ceiling {
            return;
        }
        // A label at the right edge would leave the picture: anchor it to its end there.
        let anchor = if x > WIDTH - 160.0 { "end" } else { "start" };
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\" font-size=\"11\" fill=\"#000000\">▲ {} {}</text>",
            x + if anchor == "start" { 0.0 } else { slot },
            TOP - 4.0,
            if bar.key { "keyframe" } else { "frame" },
            number::bytes(total)
        );
    }
}

/// Returns the next round number (1, 2, 2.5 or 5 times a power of ten) at or above `value`.
fn nice_above(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    [1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0]
        .into_iter()
        .map(|step| step * power)
        .find(|&nice| nice >= value)
        .unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(bars: Vec<Bar>) -> Plot {
        Plot {
            title: "a <scene>".to_owned(),
            parts: vec!["cells".to_owned(), "buckets".to_owned()],
            bars,
            fps: 60.0,
        }
    }

    #[test]
    fn the_axis_fits_the_deltas_and_the_keyframe_says_its_size() {
        let svg = plot(vec![
            Bar { frame: 0, key: true, bytes: vec![700_000, 12_000] },
            Bar { frame: 1, key: false, bytes: vec![900, 100] },
        ])
        .svg();
        assert!(svg.contains("1.0 kB"), "{svg}");
        assert!(svg.contains("keyframe 712.0 kB"), "{svg}");
        assert!(svg.contains("a &lt;scene&gt;"));
    }

    #[test]
    fn a_recording_without_frames_is_an_empty_plot() {
        assert!(plot(Vec::new()).svg().ends_with("</svg>\n"));
    }

    #[test]
    fn round_numbers_are_at_or_above() {
        for (value, nice) in [(1.0, 1.0), (1.1, 2.0), (2.2, 2.5), (712.0, 800.0), (9000.0, 10_000.0)] {
            assert!((nice_above(value) - nice).abs() < 1e-6 * nice, "{value} gave {}", nice_above(value));
        }
    }
}
