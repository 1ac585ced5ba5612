//! The one-page report of `psao demo`: figures, plot and pictures in one file that opens offline.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use psao_eval::report::escape;

/// A picture with its caption; `png` is the file's bytes.
pub(crate) struct Picture {
    pub(crate) caption: String,
    pub(crate) png: Vec<u8>,
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
    pub(crate) sections: Vec<Section>,
    /// A complete SVG document.
    pub(crate) plot: String,
    pub(crate) pictures: Vec<Picture>,
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem;color:#1a1a1a}\
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.15rem;margin-top:2rem}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
td,th{padding:.2rem .9rem .2rem 0;border-bottom:1px solid #ddd;text-align:right}\
td:first-child,th:first-child{text-align:left}\
figure{margin:1.2rem 0}img,svg{max-width:100%;height:auto;border:1px solid #ddd}\
figcaption,.note{color:#555;font-size:.9rem;max-width:48rem}";

impl Report {
    /// Returns the page.
    pub(crate) fn html(&self) -> String {
        let mut out = String::new();
        let _ = write!(
            out,
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
             <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body>\n\
             <h1>{title}</h1>\n<p>{}</p>\n",
            escape(&self.lead),
            title = escape(&self.title),
        );
        for section in &self.sections {
            section.html(&mut out);
        }
        let _ = write!(out, "<h2>Bytes of every frame</h2>\n<figure>{}</figure>\n", self.plot);
        out.push_str("<h2>Pictures</h2>\n");
        for picture in &self.pictures {
            let _ = writeln!(
                out,
                "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption>\
                 </figure>",
                STANDARD.encode(&picture.png),
                caption = escape(&picture.caption),
            );
        }
        out.push_str("</body></html>\n");
        out
    }
}

impl Section {
    fn html(&self, out: &mut String) {
        let _ = write!(out, "<h2>{}</h2>\n<table><thead><tr>", escape(&self.title));
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
        let _ = write!(out, "</tbody></table>\n<p class=\"note\">{}</p>\n", escape(&self.note));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_needs_nothing_from_outside_and_escapes_what_it_is_given() {
        let page = Report {
            title: "a & b".to_owned(),
            lead: "<script>".to_owned(),
            sections: vec![Section {
                title: "t".to_owned(),
                heads: vec!["h".to_owned()],
                rows: vec![vec!["1 < 2".to_owned()]],
                note: String::new(),
            }],
            plot: "<svg/>".to_owned(),
            pictures: vec![Picture { caption: "p".to_owned(), png: vec![1, 2, 3] }],
        }
        .html();
        assert!(page.contains("data:image/png;base64,AQID"), "{page}");
        assert!(page.contains("1 &lt; 2") && !page.contains("<script>"));
        assert!(!page.contains("http"), "a page that opens offline loads nothing: {page}");
    }
}
