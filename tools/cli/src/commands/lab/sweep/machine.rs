//! The machine that times are of.

use serde::Serialize;

/// What times depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Machine {
    /// Name of the processor, as far as it says.
    pub(super) cpu: String,
    /// Threads that work.
    pub(super) threads: usize,
    /// Operating system and architecture.
    pub(super) system: String,
    /// How this program was built.
    pub(super) build: &'static str,
    /// Program that codes video, where there is one and it is wanted.
    pub(super) video: Option<String>,
    /// Version of this program.
    pub(super) version: &'static str,
}

impl Machine {
    /// Describes this machine.
    pub(super) fn here() -> Self {
        let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            cpu: model(&text).unwrap_or("unknown").to_owned(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            build: if cfg!(debug_assertions) { "debug" } else { "release" },
            video: None,
            version: env!("CARGO_PKG_VERSION"),
        }
    }

    /// Returns names and values, for people.
    pub(super) fn rows(&self) -> Vec<(String, String)> {
        let rows = [
            ("processor", self.cpu.clone()),
            ("threads", self.threads.to_string()),
            ("system", self.system.clone()),
            ("build", self.build.to_owned()),
            ("video coder", self.video.clone().unwrap_or_else(|| "none".to_owned())),
            ("version", self.version.to_owned()),
        ];
        rows.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}

/// Returns the first processor's name in `/proc/cpuinfo`.
fn model(text: &str) -> Option<&str> {
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim()).filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_processor_has_a_name() {
        assert_eq!(model("processor\t: 0\nmodel name\t: A B: C\nmodel name\t: D\n"), Some("A B: C"));
        assert_eq!(model("model name\t:\n"), None);
        assert_eq!(model(""), None);
    }
}
