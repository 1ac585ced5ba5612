//! The one-page report of `psao demo`: pictures, figures and plot in one file that opens offline.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use psao_eval::report::escape;

/// A frame drawn from the stream and by rays, with its caption; pictures are the bytes of PNG files.
pub(crate) struct Comparison {
    pub(crate) title: String,
    pub(crate) caption: String,
    pub(crate) stream: Vec<u8>,
    pub(crate) reference: Vec<u8>,
    pub(crate) difference: Vec<u8>,
}

/// A table with a caption and a sentence below it.
pub(crate) struct Section {
    pub(crate) title: String,
    pub(crate) heads: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
    pub(crate) note: String,
}

/// What the page holds, top to bottom.
pub(crate) struct Report {
    pub(crate) title: String,
    pub(crate) lead: String,
    pub(crate) comparisons: Vec<Comparison>,
    pub(crate) sections: Vec<Section>,
    /// A complete SVG document.
    pub(crate) plot: String,
}

/// Styles of the page. The plot has colours of its own for a light ground.
const STYLE: &str = include_str!("report.css");

/// Moves the edge between the two pictures of a comparison. Without scripts, the page shows both halves.
const SCRIPT: &str = "for(const range of document.querySelectorAll('.wipe input'))\
range.addEventListener('input',()=>range.parentElement.style.setProperty('--edge',range.value+'%'));";

impl Report {
    /// Returns the page.
    pub(crate) fn html(&self) -> String {
        let mut out = String::new();
        let _ = write!(
            out,
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n<p>{}</p>\n",
            escape(&self.lead),
            title = escape(&self.title),
        );
        for comparison in &self.comparisons {
            comparison.html(&mut out);
        }
        for section in &self.sections {
            section.html(&mut out);
        }
        let _ = write!(out, "<h2>Bytes of every frame</h2>\n<figure class=\"plot\">{}</figure>\n", self.plot);
        let _ = writeln!(out, "<script>{SCRIPT}</script></body></html>");
        out
    }
}

impl Comparison {
    /// Writes the two pictures on top of each other, with a slider for the edge between them, and their difference.
    fn html(&self, out: &mut String) {
        let source = |png: &[u8]| format!("data:image/png;base64,{}", STANDARD.encode(png));
        let _ = write!(
            out,
            "<h2>{title}</h2>\n<figure><div class=\"wipe\">\
             <img alt=\"{title}, by rays\" src=\"{}\"><img class=\"over\" alt=\"{title}, from the stream\" src=\"{}\">\
             <span class=\"left\">stream</span><span class=\"right\">rays</span>\
             <input type=\"range\" min=\"0\" max=\"100\" value=\"50\" step=\"0.1\" \
             aria-label=\"Edge between the picture from the stream and the one by rays, percent\"></div>\n\
             <figcaption>{}</figcaption>\n\
             <details><summary>Difference times four: red is too bright, blue is too dark</summary>\
             <img alt=\"{title}, difference\" src=\"{}\"></details></figure>\n",
            source(&self.reference),
            source(&self.stream),
            escape(&self.caption),
            source(&self.difference),
            title = escape(&self.title),
        );
    }
}

impl Section {
    fn html(&self, out: &mut String) {
        let _ = write!(out, "<h2>{}</h2>\n<div class=\"table\"><table><thead><tr>", escape(&self.title));
        for head in &self.heads {
            let _ = write!(out, "<th>{}</th>", escape(head));
        }
        out.push_str("</tr></thead><tbody>\n");
        for row in &self.rows {
            out.push_str("<tr>");
            for cell in row {
                let _ = write!(out, "<td>{}</td>", escape(cell));
            }
            out.push_str("</tr>\n");
        }
        let _ = write!(out, "</tbody></table></div>\n<p class=\"note\">{}</p>\n", escape(&self.note));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_needs_nothing_from_outside_and_escapes_what_it_is_given() {
        let page = Report {
            title: "a & b".to_owned(),
            lead: "<script>alert".to_owned(),
            comparisons: vec![Comparison {
                title: "frame 1 < 2".to_owned(),
                caption: "p".to_owned(),
                stream: vec![1, 2, 3],
                reference: vec![4, 5, 6],
                difference: vec![7, 8, 9],
            }],
            sections: vec![Section {
                title: "t".to_owned(),
                heads: vec!["h".to_owned()],
                rows: vec![vec!["1 < 2".to_owned()]],
                note: String::new(),
            }],
            plot: "<svg/>".to_owned(),
        }
        .html();
        for picture in ["AQID", "BAUG", "BwgJ"] {
            assert!(page.contains(&format!("data:image/png;base64,{picture}")), "{page}");
        }
        assert!(page.contains("1 &lt; 2") && !page.contains("<script>alert"));
        assert!(page.find("AQID") < page.find("<table"), "the page begins with the pictures");
        assert!(!page.contains("http"), "a page that opens offline loads nothing: {page}");
    }
}
