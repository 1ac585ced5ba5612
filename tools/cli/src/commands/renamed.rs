//! Commands that were renamed: the old names work, and say the new ones.

use std::ffi::OsString;

/// Old names and what stands for them now, word by word.
const RENAMED: [(&[&str], &[&str]); 7] = [
    (&["evaluate"], &["lab", "sweep"]),
    (&["compare-profiles"], &["lab", "profiles"]),
    (&["compare-budgets"], &["lab", "budgets"]),
    (&["needs"], &["lab", "needs"]),
    (&["stress"], &["lab", "stress"]),
    (&["bench"], &["lab"]),
    (&["netlab"], &["lab", "network"]),
];

/// Replaces the old name of a command by the new one, also behind `help`. Returns the new arguments and, where something
/// was replaced, the line that says so.
pub(crate) fn current(arguments: Vec<OsString>) -> (Vec<OsString>, Option<String>) {
    let at = if arguments.get(1).is_some_and(|first| first == "help") { 2 } else { 1 };
    let named = |(old, _): &&(&[&str], &[&str])| {
        arguments.get(at..at + old.len()).is_some_and(|given| given.iter().zip(*old).all(|(a, b)| a == b))
    };
    let Some((old, new)) = RENAMED.iter().find(named) else { return (arguments, None) };
    let note = format!("psao: `psao {}` is now `psao {}`", old.join(" "), new.join(" "));
    let mut replaced = arguments;
    replaced.splice(at..at + old.len(), new.iter().map(OsString::from));
    (replaced, Some(note))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<OsString> {
        line.split(' ').map(OsString::from).collect()
    }

    #[test]
    fn old_names_become_new_ones_and_nothing_else_changes() {
        for (typed, meant) in [
            ("psao evaluate colonnade --json", "psao lab sweep colonnade --json"),
            ("psao bench rays --scene a", "psao lab rays --scene a"),
            ("psao help netlab", "psao help lab network"),
        ] {
            let (replaced, note) = current(words(typed));
            assert_eq!(replaced, words(meant));
            assert!(note.is_some_and(|note| note.contains("is now `psao lab")), "{typed}");
        }
        for same in
            ["psao", "psao help", "psao record evaluate", "psao lab needs needs", "psao inspect needs"]
        {
            assert_eq!(current(words(same)), (words(same), None));
        }
    }
}
