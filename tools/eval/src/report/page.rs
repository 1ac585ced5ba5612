//! The HTML page: one file that opens offline, without scripts, light or dark as the reader's system is.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::plot::{Dot, FAMILY_COLOURS, Plot, ReferenceLine, colour, mark};
use super::table::{ms, table};
use super::{Cost, best_by_budget, escape};
use crate::sweep::{Record, RecordKind};

/// A picture, or two pictures side by side.
pub struct Thumbnail {
    /// Caption.
    pub caption: String,
    /// The bytes of PNG files.
    pub pngs: Vec<Vec<u8>>,
}

/// The section of a scene.
pub struct SceneSection<'a> {
    /// Name of the scene.
    pub scene: String,
    /// Measured settings and methods, in the order of the table.
    pub records: Vec<&'a Record>,
    /// The same moment by every setting or method.
    pub pictures: Vec<Thumbnail>,
}

/// Contents of the page.
pub struct Page<'a> {
    /// Heading.
    pub title: String,
    /// Sentences about the measurement.
    pub notes: Vec<String>,
    /// Facts of the machine and the program: name and value.
    pub machine: Vec<(String, String)>,
    /// Sections, one for each scene.
    pub sections: Vec<SceneSection<'a>>,
}

/// Selects an error figure of a record.
type ErrorOf = fn(&Record) -> f64;

const STYLE: &str = ":root{--ink:#1a1a1a;--soft:#5c5c5c;--line:#d8d8d8;--back:#fff;--card:#f6f6f6}\
@media(prefers-color-scheme:dark){:root{--ink:#e8e8e8;--soft:#a5a5a5;--line:#3a3a3a;--back:#161618;--card:#1f1f22}}\
body{font:15px/1.5 system-ui,sans-serif;max-width:84rem;margin:2rem auto;padding:0 1rem;color:var(--ink);\
background:var(--back)}h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.3rem;margin-top:2.5rem}\
h3{font-size:1.05rem;margin:1.6rem 0 .4rem}.note,figcaption,summary{color:var(--soft);font-size:.9rem}\
.note{max-width:56rem}.scroll{overflow-x:auto}table{border-collapse:collapse;font-size:.86rem;\
font-variant-numeric:tabular-nums;white-space:nowrap}td,th{padding:.2rem .7rem .2rem 0;\
border-bottom:1px solid var(--line);text-align:right}th{color:var(--soft);font-weight:600;vertical-align:bottom;\
white-space:normal}.words td:nth-child(2),.words th:nth-child(2),.words td:nth-child(3),.words th:nth-child(3),.plain td,.plain th{text-align:left}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(32rem,1fr));gap:1rem}\
.thumbs{display:grid;grid-template-columns:repeat(auto-fill,minmax(26rem,1fr));gap:1rem}figure{margin:0}\
figure div{display:flex;gap:4px}figure img{width:calc(50% - 2px);height:auto;box-sizing:border-box;\
border:1px solid var(--line)}svg{width:100%;height:auto;background:var(--card);\
border-radius:6px}svg text{font:12px system-ui,sans-serif;fill:var(--ink);\
paint-order:stroke;stroke:var(--card);stroke-width:3px}svg .title{font-size:14px;font-weight:600}\
svg .tick,svg .faint,svg .number{fill:var(--soft);font-size:11px}svg .best{font-size:11px;font-weight:700}\
svg .grid{stroke:var(--line)}svg .frame{fill:none;stroke:var(--soft)}svg .front{fill:none;stroke:var(--soft);\
stroke-width:1.5;stroke-dasharray:5 4}svg .level{stroke-width:1.5;stroke-dasharray:2 4;stroke:currentColor}\
svg g{color:var(--soft);stroke:var(--card);stroke-width:1}.legend{display:flex;flex-wrap:wrap;gap:.2rem 1.2rem;\
margin:.6rem 0;font-size:.9rem}.legend svg{width:16px;height:16px;background:none;vertical-align:-3px;margin-right:.3rem}";

impl Page<'_> {
    /// Returns the HTML text.
    #[must_use]
    pub fn html(&self) -> String {
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\
             <meta name=\"viewport\" content=\"width=device-width\"><meta name=\"color-scheme\" content=\"light dark\">\
             <style>{STYLE}{1}</style></head><body>\n<h1>{0}</h1>\n",
            escape(&self.title),
            family_colours()
        );
        for note in &self.notes {
            let _ = writeln!(out, "<p class=\"note\">{}</p>", escape(note));
        }
        for section in &self.sections {
            section.html(&mut out);
        }
        out.push_str("<h2>The machine</h2>\n<table class=\"plain\"><tbody>\n");
        for (name, value) in &self.machine {
            let _ = writeln!(out, "<tr><td>{}</td><td>{}</td></tr>", escape(name), escape(value));
        }
        out.push_str("</tbody></table>\n</body></html>\n");
        out
    }
}

fn family_colours() -> String {
    let rule = |(class, colour)| format!("svg .f{class}{{fill:{colour};color:{colour}}}");
    (0..).zip(FAMILY_COLOURS).map(rule).collect()
}

impl SceneSection<'_> {
    fn html(&self, out: &mut String) {
        let _ = writeln!(out, "<h2>{}</h2>", escape(&self.scene));
        self.thumbnails(out);
        self.plots(out);
        self.advice(out);
        let (heads, rows) = table(&self.records, true);
        out.push_str("<h3>All figures</h3>\n");
        rows_html(out, &heads, &rows);
        self.stages(out);
    }

    /// Returns the names of profiles and methods in the order of their first mention.
    fn families(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for record in &self.records {
            if !names.contains(&record.name.as_str()) {
                names.push(&record.name);
            }
        }
        names
    }

    fn thumbnails(&self, out: &mut String) {
        if self.pictures.is_empty() {
            return;
        }
        out.push_str("<div class=\"thumbs\">\n");
        for picture in &self.pictures {
            let caption = escape(&picture.caption);
            let _ = writeln!(out, "<figure><div>");
            for png in &picture.pngs {
                let data = STANDARD.encode(png);
                let _ = writeln!(out, "<img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">");
            }
            let _ = writeln!(out, "</div><figcaption>{caption}</figcaption></figure>");
        }
        out.push_str("</div>\n");
    }

    fn plots(&self, out: &mut String) {
        let families = self.families();
        out.push_str("<h3>Error against cost</h3>\n<div class=\"legend\">");
        for (family, name) in families.iter().enumerate() {
            let _ = write!(
                out,
                "<span><svg viewBox=\"0 0 16 16\"><g class=\"f{}\">{}</g></svg>{}</span>",
                colour(family),
                mark(family, (8.0, 8.0)),
                escape(name)
            );
        }
        out.push_str(
            "<span>- - - front: the smallest error for each cost</span></div>\n<div class=\"plots\">\n",
        );
        let figures: [(&str, ErrorOf); 2] =
            [("mean absolute error, e_A", |r| r.error.mae), ("FLIP", |r| r.error.flip)];
        for (up, error) in figures {
            for cost in [Cost::PictureMs, Cost::MbitPerSecond] {
                if self.records.iter().any(|record| cost.of(record).is_some()) {
                    out.push_str(&self.plot(&families, cost, up, error));
                }
            }
        }
        out.push_str(
            "</div>\n<p class=\"note\">Numbers refer to the table below; point at a mark to see its setting. Both axes \
             are logarithmic, lower left is better. A dotted line is the best result of a method that needs no \
             bytes.</p>\n",
        );
    }

    fn plot(&self, families: &[&str], cost: Cost, up: &str, error: ErrorOf) -> String {
        let family = |record: &Record| families.iter().position(|name| *name == record.name).unwrap_or(0);
        let title = |record: &Record| {
            let mbit_s = record.stream.map_or_else(String::new, |s| format!(", {:.3} Mbit/s", s.wire_mbit_s));
            let spent = format!("{} ms a picture{mbit_s}", ms(record.picture_ms.median));
            format!("{}: e_A {:.4}, FLIP {:.4}, {spent}", record.title(), record.error.mae, record.error.flip)
        };
        let dot = |(number, record): (usize, &&Record)| {
            let at = (cost.of(record)?, error(record));
            Some(Dot { number, at, family: family(record), title: title(record) })
        };
        let dots: Vec<Dot> = (1..).zip(&self.records).filter_map(dot).collect();
        let free = |name: &&str| {
            let of_name = self.records.iter().filter(|record| record.name == **name);
            let best = of_name.min_by(|a, b| error(a).total_cmp(&error(b)))?;
            let level = ReferenceLine {
                error: error(best),
                family: family(best),
                name: &best.name,
                title: title(best),
            };
            (cost == Cost::MbitPerSecond && best.kind == RecordKind::Screen).then_some(level)
        };
        let levels: Vec<ReferenceLine> = families.iter().filter_map(free).collect();
        let (across, heading) = match cost {
            Cost::PictureMs => ("milliseconds a picture, on the client", "run time"),
            Cost::MbitPerSecond => ("Mbit/s, everything on the wire", "bandwidth"),
        };
        let heading = format!("{} against {heading}", up.split(',').next().unwrap_or(up));
        Plot { title: &heading, across, up, dots: &dots, levels: &levels }.svg()
    }

    fn advice(&self, out: &mut String) {
        for (cost, unit, head) in [
            (Cost::MbitPerSecond, "Mbit/s", "What to choose for a bandwidth"),
            (Cost::PictureMs, "ms a picture", "What to choose for a time on the client"),
        ] {
            let steps = best_by_budget(&self.records, cost);
            if steps.is_empty() {
                continue;
            }
            let _ = writeln!(out, "<h3>{head}</h3>\n<table class=\"plain\"><tbody>");
            for step in steps {
                let _ = writeln!(
                    out,
                    "<tr><td>from {:.3} {unit}</td><td>{}. {}</td><td>e_A {:.4}</td></tr>",
                    step.budget,
                    step.index + 1,
                    escape(&self.records[step.index].title()),
                    step.mae
                );
            }
            out.push_str("</tbody></table>\n");
        }
    }

    fn stages(&self, out: &mut String) {
        out.push_str("<details><summary>Milliseconds of every stage: median (quartiles)</summary>\n");
        let heads =
            ["#", "what", "setting", "stage", "side", "median", "quartiles", "samples"].map(str::to_owned);
        let mut rows = Vec::new();
        for (number, record) in (1_usize..).zip(&self.records) {
            for stage in &record.stages {
                rows.push(vec![
                    number.to_string(),
                    record.name.clone(),
                    record.label.clone(),
                    stage.name.clone(),
                    stage.side.clone(),
                    ms(stage.ms.median),
                    format!("{}\u{2013}{}", ms(stage.ms.low), ms(stage.ms.high)),
                    stage.ms.samples.to_string(),
                ]);
            }
        }
        rows_html(out, &heads, &rows);
        out.push_str("</details>\n");
    }
}

fn rows_html(out: &mut String, heads: &[String], rows: &[Vec<String>]) {
    let cells = |tag: &str, cells: &[String]| {
        let cell = |cell: &String| format!("<{tag}>{}</{tag}>", escape(cell));
        format!("<tr>{}</tr>\n", cells.iter().map(cell).collect::<String>())
    };
    let _ = write!(
        out,
        "<div class=\"scroll\"><table class=\"words\"><thead>{}</thead><tbody>\n{}</tbody></table></div>\n",
        cells("th", heads),
        rows.iter().map(|row| cells("td", row)).collect::<String>()
    );
}

#[cfg(test)]
mod tests {
    use super::super::samples::record;
    use super::*;

    #[test]
    fn the_page_needs_nothing_from_outside_and_escapes_what_it_is_given() {
        let records = [
            record("surface", 0.02, 5.0, Some(1.0)),
            record("paper", 0.03, 6.0, Some(20.0)),
            record("ssao", 0.08, 2.0, None),
        ];
        let page = Page {
            title: "a & b".to_owned(),
            notes: vec!["<script>".to_owned()],
            machine: vec![("cores".to_owned(), "2".to_owned())],
            sections: vec![SceneSection {
                scene: records[0].scene.clone(),
                records: records.iter().collect(),
                pictures: vec![Thumbnail { caption: "p".to_owned(), pngs: vec![vec![1, 2, 3]] }],
            }],
        }
        .html();
        assert!(page.contains("data:image/png;base64,AQID"), "{page}");
        assert!(page.contains("a &lt;scene&gt;") && !page.contains("<script"));
        assert!(!page.contains("http"), "a page that opens offline loads nothing: {page}");
        // There are plots of two errors by two costs.
        assert_eq!(page.matches("role=\"img\"").count(), 4);
        assert_eq!(
            page.matches("class=\"level\"").count(),
            2,
            "the method that needs no bytes, against bandwidth"
        );
        for tag in ["svg", "table", "div", "g", "details"] {
            let opened =
                page.matches(&format!("<{tag} ")).count() + page.matches(&format!("<{tag}>")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
