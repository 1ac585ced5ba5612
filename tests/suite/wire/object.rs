//! JSON objects in the fixed format of the vectors.

use std::fmt::{Display, Write};

/// A JSON object that keeps the order of its values.
#[derive(Default)]
pub(super) struct Object(Vec<String>);

impl Object {
    pub(super) fn with(mut self, name: &str, value: impl Display) -> Object {
        self.0.push(format!("\"{name}\": {value}"));
        self
    }

    pub(super) fn text(self, name: &str, text: &str) -> Object {
        self.with(name, quoted(text))
    }

    pub(super) fn hex(self, name: &str, bytes: &[u8]) -> Object {
        self.with(name, format!("\"{}\"", hex(bytes)))
    }

    /// Adds a number with the fewest digits that identify it.
    pub(super) fn float(self, name: &str, value: f32) -> Object {
        self.with(name, format!("{value:?}"))
    }

    /// Returns the object on one line.
    pub(super) fn line(&self) -> String {
        format!("{{{}}}", self.0.join(", "))
    }

    /// Returns the object with one value per line.
    pub(super) fn lines(&self) -> String {
        format!("{{\n{}\n}}", self.0.join(",\n"))
    }

    /// Returns the text of a file that holds this object.
    pub(super) fn file(&self) -> String {
        self.lines() + "\n"
    }
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn quoted(text: &str) -> String {
    let mut out = String::from('"');
    for character in text.chars() {
        match character {
            '"' | '\\' => out.extend(['\\', character]),
            '\0'..='\x1f' => write!(out, "\\u{:04x}", u32::from(character)).unwrap(),
            _ => out.push(character),
        }
    }
    out.push('"');
    out
}
