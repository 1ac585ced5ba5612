//! The edits in force at a place of a stream.

use std::collections::BTreeMap;

use crate::message::{Edit, EditAction};

/// The property of an instance that an edit sets. A newer edit of a property replaces an older one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Property {
    Pose,
    Visibility,
}

/// The edits that make a scene differ from its animation: the newest edit of each instance and property, unless it
/// restores the animation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditsInForce(BTreeMap<(u32, Property), Edit>);

impl EditsInForce {
    /// Adds an edit, or removes those that it reverts.
    pub fn apply(&mut self, edit: &Edit) {
        let (property, overrides) = match edit.action {
            EditAction::Move { .. } => (Property::Pose, true),
            EditAction::Release => (Property::Pose, false),
            EditAction::Hide => (Property::Visibility, true),
            EditAction::Show => (Property::Visibility, false),
        };
        if overrides {
            self.0.insert((edit.instance, property), *edit);
        } else {
            self.0.remove(&(edit.instance, property));
        }
    }

    /// Iterates over the edits in the order of instances.
    pub fn iter(&self) -> impl Iterator<Item = &Edit> {
        self.0.values()
    }

    /// Returns whether the scene follows its animation.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_edit_of_each_kind_counts() {
        let mut edits = EditsInForce::default();
        let moved = |x| EditAction::Move { translation: [x, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
        for (instance, action) in [
            (3, moved(1.0)),
            (1, EditAction::Hide),
            (3, EditAction::Hide),
            (3, moved(2.0)),
            (1, EditAction::Show),
            (2, moved(0.0)),
            (2, EditAction::Release),
        ] {
            edits.apply(&Edit { instance, action });
        }
        let left: Vec<_> = edits.iter().map(|edit| (edit.instance, edit.action)).collect();
        assert_eq!(left, [(3, moved(2.0)), (3, EditAction::Hide)]);
        edits.apply(&Edit { instance: 3, action: EditAction::Release });
        edits.apply(&Edit { instance: 3, action: EditAction::Show });
        assert!(edits.is_empty());
    }
}
