//! Scripts of edits by frame: `psao record --edits FILE`, `psao client --edits FILE`.

use std::collections::BTreeMap;
use std::path::Path;

use psao_proto::message::{Edit, EditAction};
use psao_server::scene::{Edits, Scene};

use crate::args::numbers;
use crate::error::{Failure, Outcome};
use crate::input::load;

/// Edits by the frame that they come before, in the order of the file.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct EditScript(BTreeMap<u32, Vec<Edit>>);

impl EditScript {
    /// Reads a script for a recording of `frames` frames, where the number is known. Every line is checked, so a mistake is
    /// found before anything is traced.
    pub(crate) fn load(path: &Path, scene: &Scene, frames: Option<u32>) -> Outcome<Self> {
        let text = String::from_utf8(load(path)?)
            .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
        Self::parse(&text, scene, frames)
            .map_err(|error| Failure::input(format_args!("{}:{error}", path.display())))
    }

    /// The error starts with the number of its line, from 1.
    fn parse(text: &str, scene: &Scene, frames: Option<u32>) -> Result<Self, String> {
        let mut script = Self::default();
        let mut checked = Edits::new(scene.instances().len() as u32);
        for (number, line) in (1..).zip(text.lines()) {
            let wrong = |error: String| format!("{number}: {error}");
            let words = shlex::split(line).ok_or_else(|| wrong("a quote is not closed".to_owned()))?;
            if words.is_empty() {
                continue;
            }
            let (frame, edit) = edit(&words, scene).map_err(wrong)?;
            checked.apply(&edit).map_err(|error| wrong(error.to_string()))?;
            if let Some(frames) = frames.filter(|frames| frame >= *frames) {
                return Err(wrong(format!(
                    "there is no frame {frame}: {frames} frames are recorded, counted from 0"
                )));
            }
            script.0.entry(frame).or_default().push(edit);
        }
        Ok(script)
    }

    /// Removes and returns the edits of a frame and of those before it.
    pub(crate) fn take_until(&mut self, frame: u32) -> Vec<Edit> {
        let later = frame.checked_add(1).map_or_else(BTreeMap::new, |next| self.0.split_off(&next));
        std::mem::replace(&mut self.0, later).into_values().flatten().collect()
    }

    /// Returns the edits that come before a frame.
    pub(crate) fn before(&self, frame: u32) -> &[Edit] {
        self.0.get(&frame).map_or(&[], Vec::as_slice)
    }
}

fn edit(words: &[String], scene: &Scene) -> Result<(u32, Edit), String> {
    let [frame, instance, action, rest @ ..] = words else {
        return Err("a line is FRAME INSTANCE move X,Y,Z [QX,QY,QZ,QW], or FRAME INSTANCE release|hide|show"
            .to_owned());
    };
    let frame = frame.parse().map_err(|_| format!("\"{frame}\" is not the number of a frame"))?;
    let instance = find(instance, scene)?;
    let action = match (action.as_str(), rest) {
        ("release", []) => EditAction::Release,
        ("hide", []) => EditAction::Hide,
        ("show", []) => EditAction::Show,
        ("move", [at]) => EditAction::Move { translation: translation(at)?, rotation: [0.0, 0.0, 0.0, 1.0] },
        ("move", [at, turn]) => EditAction::Move { translation: translation(at)?, rotation: rotation(turn)? },
        ("move", _) => {
            return Err("move takes X,Y,Z and perhaps QX,QY,QZ,QW, without spaces in them".to_owned());
        }
        ("release" | "hide" | "show", _) => return Err(format!("{action} takes nothing more")),
        _ => return Err(format!("\"{action}\" is not an action: use move, release, hide or show")),
    };
    Ok((frame, Edit { instance, action }))
}

fn translation(text: &str) -> Result<[f32; 3], String> {
    numbers(text).ok_or_else(|| format!("\"{text}\" is not three numbers such as 1.5,0,-2"))
}

fn rotation(text: &str) -> Result<[f32; 4], String> {
    numbers(text).ok_or_else(|| format!("\"{text}\" is not a quaternion such as 0,0.7071,0,0.7071"))
}

/// Returns the instance with an index or a name.
fn find(text: &str, scene: &Scene) -> Result<u32, String> {
    if let Ok(index) = text.parse() {
        return Ok(index);
    }
    let named = (0..).zip(scene.instances()).filter(|(_, instance)| instance.name() == text);
    let found: Vec<u32> = named.map(|(index, _)| index).collect();
    match found[..] {
        [one] => Ok(one),
        [] => Err(format!("no instance is named \"{text}\"; `psao scenes --instances` lists them")),
        [first, second, ..] => Err(format!(
            "{} instances are named \"{text}\": say which by its index, such as {first} or {second}",
            found.len()
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<EditScript, String> {
        EditScript::parse(text, &Scene::load("colonnade").unwrap(), Some(10))
    }

    #[test]
    fn lines_become_edits_of_their_frames() {
        let scene = Scene::load("colonnade").unwrap();
        let text = "# a script\n\n 3 7 move 1,-2.5,0\n3 \"boulder 0\" hide # gone\n\
                    0 7 move 0,0,0 0,0.6,0,0.8\n9 7 release\n9 7 show\n";
        let script = parse(text).unwrap();
        let boulder = scene.instances().iter().position(|i| i.name() == "boulder 0").unwrap() as u32;
        let moved = |translation, rotation| EditAction::Move { translation, rotation };
        let of = |instance, action| Edit { instance, action };
        assert_eq!(
            script.before(3),
            [of(7, moved([1.0, -2.5, 0.0], [0.0, 0.0, 0.0, 1.0])), of(boulder, EditAction::Hide)]
        );
        assert_eq!(script.before(0), [of(7, moved([0.0; 3], [0.0, 0.6, 0.0, 0.8]))]);
        assert_eq!(script.before(9), [of(7, EditAction::Release), of(7, EditAction::Show)]);
        assert_eq!(script.before(1), []);
        assert_eq!(parse("#only this").unwrap(), EditScript::default());
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, said) in [
            ("1 2", "FRAME INSTANCE"),
            ("x 2 hide", "\"x\" is not the number of a frame"),
            ("-1 2 hide", "not the number of a frame"),
            ("1 2 fly", "use move, release, hide or show"),
            ("1 2 hide now", "hide takes nothing more"),
            ("1 2 move", "move takes"),
            ("1 2 move 1, 2, 3", "move takes"),
            ("1 2 move 1,2", "not three numbers"),
            ("1 2 move nan,0,0", "not three numbers"),
            ("1 2 move 1e30,0,0", "beyond 1e9 m"),
            ("1 2 move 1,2,3 0,0,0", "not a quaternion"),
            ("1 2 move 1,2,3 0,0,0,2", "not a unit quaternion"),
            ("1 9999 hide", "instance 9999 does not exist"),
            ("1 nobody hide", "no instance is named \"nobody\""),
            ("1 column hide", "instances are named \"column\""),
            ("1 \"boulder 0 hide", "a quote is not closed"),
            ("10 2 hide", "there is no frame 10: 10 frames are recorded"),
        ] {
            let error = parse(&format!("# first\n{text}\n")).unwrap_err();
            assert!(error.starts_with("2: ") && error.contains(said), "{text}: {error}");
        }
    }
}
