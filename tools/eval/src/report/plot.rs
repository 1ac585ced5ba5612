//! Plots of error against cost, both on logarithmic axes, as SVG in the page's colours.

use std::fmt::Write as _;

use super::{COLOURS, escape, pareto_front};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;
/// Colours of families. Yellow is left out because it is too pale on white, dark grey because it is too dark on black.
pub(super) const FAMILY_COLOURS: [&str; 7] =
    [COLOURS[0], COLOURS[1], COLOURS[2], COLOURS[3], COLOURS[4], COLOURS[5], "#888888"];
/// Half the width of a mark, in units of the SVG.
const MARK_RADIUS: f64 = 5.0;
/// Width and height of a mark's number.
const LABEL_SIZE: (f64, f64) = (15.0, 11.0);

/// The dot of a measured setting.
pub(super) struct Dot {
    /// Its number in the table.
    pub(super) number: usize,
    /// Cost and error, both above 0.
    pub(super) at: (f64, f64),
    /// Index of its family.
    pub(super) family: usize,
    /// Tooltip.
    pub(super) title: String,
}

/// A line across the plot: the error of a method that has no cost of the plot's kind.
pub(super) struct ReferenceLine<'a> {
    pub(super) error: f64,
    pub(super) family: usize,
    pub(super) name: &'a str,
    pub(super) title: String,
}

/// A plot of error against cost.
pub(super) struct Plot<'a> {
    pub(super) title: &'a str,
    pub(super) across: &'a str,
    pub(super) up: &'a str,
    pub(super) dots: &'a [Dot],
    pub(super) levels: &'a [ReferenceLine<'a>],
}

/// A rectangle: left, top, right, bottom.
type Rect = [f64; 4];

impl Plot<'_> {
    /// Returns the SVG element. A note beside the title counts dots that a logarithmic axis cannot show.
    pub(super) fn svg(&self) -> String {
        let drawn: Vec<&Dot> =
            self.dots.iter().filter(|dot| positive(dot.at.0) && positive(dot.at.1)).collect();
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\">\
             <text class=\"title\" x=\"{LEFT}\" y=\"18\">{0}</text>\n",
            escape(self.title)
        );
        let left_out = self.dots.len() - drawn.len();
        if left_out > 0 {
            let _ = writeln!(
                out,
                "<text class=\"faint\" x=\"{}\" y=\"18\" text-anchor=\"end\">{left_out} with a cost or error of 0 not \
                 shown</text>",
                WIDTH - RIGHT
            );
        }
        let levels = self.levels.iter().map(|level| level.error).filter(|error| positive(*error));
        let (Some(x), Some(y)) = (
            Axis::new(drawn.iter().map(|dot| dot.at.0), LEFT + 14.0, WIDTH - RIGHT - 14.0),
            Axis::new(drawn.iter().map(|dot| dot.at.1).chain(levels), HEIGHT - BOTTOM - 14.0, TOP + 14.0),
        ) else {
            out.push_str("<text x=\"62\" y=\"200\">Nothing to show.</text></svg>\n");
            return out;
        };
        self.grid(&mut out, &x, &y);
        self.lines(&mut out, &y);
        let places: Vec<(f64, f64)> =
            drawn.iter().map(|dot| (x.place(dot.at.0), y.place(dot.at.1))).collect();
        let best = pareto_front(&drawn.iter().map(|dot| dot.at).collect::<Vec<_>>());
        stairs(&mut out, &best.iter().map(|&index| places[index]).collect::<Vec<_>>());
        for (dot, place) in drawn.iter().zip(&places) {
            let _ = writeln!(
                out,
                "<g class=\"f{0}\">{1}<title>{2}: {3}</title></g>",
                colour(dot.family),
                mark(dot.family, *place),
                dot.number,
                escape(&dot.title)
            );
        }
        numbers(&mut out, &drawn, &places, &best);
        out.push_str("</svg>\n");
        out
    }

    fn grid(&self, out: &mut String, x: &Axis, y: &Axis) {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        for (value, text) in x.ticks(9) {
            let at = x.place(value);
            let _ = writeln!(
                out,
                "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{TOP}\" x2=\"{at:.1}\" y2=\"{bottom}\"/>\
                 <text class=\"tick\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
                bottom + 16.0
            );
        }
        for (value, text) in y.ticks(6) {
            let at = y.place(value);
            let _ = writeln!(
                out,
                "<line class=\"grid\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>\
                 <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
                LEFT - 6.0,
                at + 4.0
            );
        }
        let (middle_x, middle_y) = ((LEFT + right) / 2.0, (TOP + bottom) / 2.0);
        let _ = writeln!(
            out,
            "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\"/>\
             <text x=\"{middle_x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text x=\"14\" y=\"{middle_y:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 14 {middle_y:.1})\">{}</text>",
            right - LEFT,
            bottom - TOP,
            HEIGHT - 8.0,
            escape(self.across),
            escape(self.up)
        );
    }

    fn lines(&self, out: &mut String, y: &Axis) {
        let mut named: Vec<f64> = Vec::new();
        for level in self.levels.iter().filter(|level| positive(level.error)) {
            let (at, right) = (y.place(level.error), WIDTH - RIGHT);
            let _ = write!(
                out,
                "<g class=\"f{}\"><line class=\"level\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>\
                 <title>{}</title></g>",
                colour(level.family),
                escape(&level.title)
            );
            // A name stands on its line unless another name is there.
            if named.iter().all(|other| (other - at).abs() > LABEL_SIZE.1) {
                named.push(at);
                let _ = write!(
                    out,
                    "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                    right - 6.0,
                    at - 3.0,
                    escape(level.name)
                );
            }
            out.push('\n');
        }
    }
}

fn positive(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

/// Writes the front as stairs: the smallest error for each cost.
fn stairs(out: &mut String, places: &[(f64, f64)]) {
    let [(x, y), rest @ ..] = places else { return };
    let mut path = format!("M{x:.1} {TOP}V{y:.1}");
    for (x, y) in rest {
        let _ = write!(path, "H{x:.1}V{y:.1}");
    }
    let _ = writeln!(out, "<path class=\"front\" d=\"{path}H{:.1}\"/>", WIDTH - RIGHT);
}

/// Returns the number of a family's colour.
pub(super) const fn colour(family: usize) -> usize {
    family % FAMILY_COLOURS.len()
}

/// Returns the mark of a family. Marks differ in shape as well as colour; the first 35 combinations are distinct.
pub(super) fn mark(family: usize, (x, y): (f64, f64)) -> String {
    let polygon = |corners: &[(f64, f64)]| {
        let corners =
            corners.iter().map(|(dx, dy)| format!("{:.1},{:.1}", x + dx * MARK_RADIUS, y + dy * MARK_RADIUS));
        format!("<polygon points=\"{}\"/>", corners.collect::<Vec<_>>().join(" "))
    };
    match family % 5 {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{MARK_RADIUS}\"/>"),
        1 => polygon(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
        2 => polygon(&[(0.0, -1.15), (1.1, 0.85), (-1.1, 0.85)]),
        3 => polygon(&[(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)]),
        _ => polygon(&[(0.0, 1.15), (1.1, -0.85), (-1.1, -0.85)]),
    }
}

/// Writes numbers beside the marks.
fn numbers(out: &mut String, dots: &[&Dot], places: &[(f64, f64)], best: &[usize]) {
    for (index, spot) in label_places(dots, places, best) {
        let class = if best.contains(&index) { "best" } else { "number" };
        let _ = writeln!(
            out,
            "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            f64::midpoint(spot[0], spot[2]),
            spot[3] - 1.0,
            dots[index].number
        );
    }
}

/// Finds free places for the numbers of the marks, those of the front first.
fn label_places(dots: &[&Dot], places: &[(f64, f64)], best: &[usize]) -> Vec<(usize, Rect)> {
    let around = |&(x, y): &(f64, f64)| [x - MARK_RADIUS, y - MARK_RADIUS, x + MARK_RADIUS, y + MARK_RADIUS];
    let mut taken: Vec<Rect> = places.iter().map(around).collect();
    let mut found = Vec::new();
    let rest = (0..dots.len()).filter(|index| !best.contains(index));
    for index in best.iter().copied().chain(rest) {
        let (x, y) = places[index];
        let (wide, high) = (LABEL_SIZE.0 * if dots[index].number > 9 { 1.0 } else { 0.55 }, LABEL_SIZE.1);
        let (near, far) = (MARK_RADIUS + 2.0, MARK_RADIUS + 5.0);
        let around = [
            (x + near, y - near - high),
            (x - near - wide, y + near),
            (x + near, y + near),
            (x - near - wide, y - near - high),
            (x + far, y - high / 2.0),
            (x - far - wide, y - high / 2.0),
            (x - wide / 2.0, y - far - high),
            (x - wide / 2.0, y + far),
        ];
        let free = around.into_iter().map(|(left, top)| [left, top, left + wide, top + high]).find(|spot| {
            let inside =
                spot[0] > LEFT && spot[1] > TOP && spot[2] < WIDTH - RIGHT && spot[3] < HEIGHT - BOTTOM;
            inside && !taken.iter().any(|other| overlap(spot, other))
        });
        if let Some(spot) = free {
            taken.push(spot);
            found.push((index, spot));
        }
    }
    found
}

fn overlap(a: &Rect, b: &Rect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// Smallest ratio of the ends of an axis. With a smaller one, noise would look like a trend.
    const MIN_SPAN: f64 = 2.0;

    /// Makes an axis from `from` to `to` on the page; `None` without values. All values are above 0.
    fn new(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Option<Self> {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high), v| (v.min(low), v.max(high)));
        if low > high {
            return None;
        }
        let spare = (Self::MIN_SPAN / (high / low)).max(1.0).sqrt();
        Some(Self { low: low / spare, high: high * spare, from, to })
    }

    fn place(&self, value: f64) -> f64 {
        let share = libm::log(value / self.low) / libm::log(self.high / self.low);
        self.from + (self.to - self.from) * share
    }

    /// Returns about `most` round values in the range at most, with their texts.
    fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        let decades = libm::floor(libm::log10(self.low)) as i32..=libm::ceil(libm::log10(self.high)) as i32;
        let all = |steps: &[f64]| {
            let mut found: Vec<(f64, i32)> = Vec::new();
            for decade in decades.clone() {
                found.extend(steps.iter().map(|step| (step * libm::pow(10.0, f64::from(decade)), decade)));
            }
            found.retain(|(value, _)| (self.low * 0.999..=self.high * 1.001).contains(value));
            found
        };
        let finest: [&[f64]; 5] = [
            &[1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0],
            &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
            &[1.0, 2.0, 3.0, 5.0, 7.0],
            &[1.0, 2.0, 5.0],
            &[1.0],
        ];
        let chosen = finest.into_iter().map(all).find(|ticks| ticks.len() <= most);
        let text = |(value, decade): (f64, i32)| {
            let decimals = usize::try_from(1 - decade).unwrap_or(0);
            let text = format!("{value:.decimals$}");
            let short =
                if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
            (value, short.to_owned())
        };
        chosen.unwrap_or_else(|| all(&[1.0])).into_iter().map(text).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(low: f64, high: f64) -> Axis {
        Axis::new([low, high].into_iter(), 0.0, 100.0).unwrap()
    }

    #[test]
    fn the_middle_of_an_axis_is_the_geometric_mean() {
        assert!((axis(0.1, 10.0).place(1.0) - 50.0).abs() < 1e-9);
    }

    #[test]
    fn an_axis_of_one_value_spans_a_factor_of_two() {
        let axis = axis(3.0, 3.0);
        assert!((axis.high / axis.low - 2.0).abs() < 1e-9 && (axis.place(3.0) - 50.0).abs() < 1e-9);
        assert!(Axis::new(std::iter::empty(), 0.0, 1.0).is_none());
    }

    #[test]
    fn ticks_are_round_and_neither_few_nor_many() {
        for (low, high) in [(0.004, 0.05), (1.3, 2.1), (0.02, 900.0), (11.0, 23.0), (1e-6, 1e6)] {
            let ticks = axis(low, high).ticks(7);
            assert!((2..=13).contains(&ticks.len()), "{low} to {high}: {ticks:?}");
            for (value, text) in ticks {
                let read: f64 = text.parse().unwrap();
                assert!((read - value).abs() < 1e-6 * value, "{text} for {value}");
            }
        }
    }

    #[test]
    fn what_has_no_logarithm_is_counted_and_not_drawn() {
        let dot = |number, at| Dot { number, at, family: 0, title: "a < b".to_owned() };
        let dots = [dot(1, (1.0, 0.1)), dot(2, (0.0, 0.2)), dot(3, (2.0, 0.05))];
        let plot = Plot { title: "t", across: "x", up: "y", dots: &dots, levels: &[] };
        let svg = plot.svg();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("1 with a cost or error of 0") && svg.contains("a &lt; b"), "{svg}");
        let empty = Plot { dots: &dots[1..2], ..plot }.svg();
        assert!(empty.contains("Nothing to show"), "{empty}");
    }

    #[test]
    fn numbers_overlap_neither_each_other_nor_marks() {
        let dot = |number| Dot { number, at: (1.0, 1.0), family: 0, title: String::new() };
        let dots: Vec<Dot> = (0..40).map(dot).collect();
        let places: Vec<(f64, f64)> = (0..40).map(|n| (200.0 + f64::from(n) * 3.0, 200.0)).collect();
        let found = label_places(&dots.iter().collect::<Vec<_>>(), &places, &[39, 20]);
        assert!(found.len() > 4 && found.len() < 40 && found[0].0 == 39, "{}", found.len());
        for (index, (_, spot)) in found.iter().enumerate() {
            assert!(found[..index].iter().all(|(_, other)| !overlap(spot, other)));
            let mark =
                |&(x, y): &(f64, f64)| [x - MARK_RADIUS, y - MARK_RADIUS, x + MARK_RADIUS, y + MARK_RADIUS];
            assert!(places.iter().all(|place| !overlap(spot, &mark(place))));
        }
    }
}
