//! Objects of a vector's json, written by hand as those of the bodies' vectors are.

use std::fmt::{Display, Write};

/// Named values in the order in which they are given.
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

    /// A number with a fraction, in as many digits as tell it from all others.
    pub(super) fn float(self, name: &str, value: f32) -> Object {
        self.with(name, format!("{value:?}"))
    }

    /// In one line.
    pub(super) fn line(&self) -> String {
        format!("{{{}}}", self.0.join(", "))
    }

    /// One value a line.
    pub(super) fn lines(&self) -> String {
        format!("{{\n{}\n}}", self.0.join(",\n"))
    }

    /// The whole of a file.
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
