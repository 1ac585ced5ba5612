//! Edits: changes that clients make to a scene, on top of its animation.

use std::collections::BTreeMap;

use glam::{DQuat, Vec3};
use psao_proto::message::{Edit, EditAction};

use super::instance::ScenePose;
use super::limits::MAX_MAGNITUDE;
use super::rigid::RigidFrame;

/// Largest |length^2 - 1| of an accepted rotation; the message itself allows as much.
const UNIT_TOLERANCE: f32 = 1e-3;

/// The edits in force, one state per instance. A newer edit replaces an older one.
///
/// ```
/// use psao_proto::message::{Edit, EditAction};
/// use psao_server::scene::{Edits, Scene};
///
/// let scene = Scene::load("colonnade")?;
/// let mut edits = Edits::new(scene.instances().len() as u32);
/// let action = EditAction::Move { translation: [0.0, 9.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] };
/// assert!(edits.apply(&Edit { instance: 3, action })?);
///
/// let mut pose = scene.pose(1.5);
/// pose.apply(&edits);
/// assert_eq!(pose.instances()[3].frame().translation.y, 9.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    instances: u32,
    /// No entry equals [`InstanceOverride::default`].
    overrides: BTreeMap<u32, InstanceOverride>,
}

/// The changes to one instance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct InstanceOverride {
    frame: Option<FrameOverride>,
    hidden: bool,
}

/// A frame as the client sent it. It is kept unchanged, so that forwarding it alters no bit.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FrameOverride {
    translation: [f32; 3],
    rotation: [f32; 4],
}

/// A rejected edit. The set of edits is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// The instance does not exist.
    #[error("instance {instance} does not exist: the scene has {count}, counted from 0")]
    Instance {
        /// Instance in the edit.
        instance: u32,
        /// Number of instances.
        count: u32,
    },
    /// A pose has a NaN or an infinity.
    #[error("instance {instance}: its {what} is not finite")]
    NotFinite {
        /// Instance in the edit.
        instance: u32,
        /// `translation` or `rotation`.
        what: &'static str,
    },
    /// The rotation is not a unit quaternion.
    #[error("instance {instance}: {rotation:?} is not a unit quaternion: divide it by its length")]
    Rotation {
        /// Instance in the edit.
        instance: u32,
        /// Rotation in the edit: x, y, z, w.
        rotation: [f32; 4],
    },
    /// The translation is beyond the range in which single precision suffices.
    #[error("instance {instance}: {translation:?} is beyond {limit_m:e} m from the origin")]
    TooFar {
        /// Instance in the edit.
        instance: u32,
        /// Translation in the edit, metres.
        translation: [f32; 3],
        /// The limit on each axis, metres.
        limit_m: f64,
    },
}

impl Edits {
    /// Creates an empty set of edits for a scene of `instances` instances.
    #[must_use]
    pub fn new(instances: u32) -> Self {
        Self { instances, overrides: BTreeMap::new() }
    }

    /// Applies an edit. Returns whether it changed anything.
    ///
    /// `Move` replaces the frame from the instance's local space to the world until `Release`. Deforming geometry
    /// continues to deform inside the new frame. The rotation is normalised in double precision before use. `Hide`
    /// removes the instance from sight and from all occlusion until `Show`.
    ///
    /// # Errors
    /// Returns [`EditError`] and changes nothing if the instance does not exist or the pose is not finite. The same
    /// holds for a rotation whose squared length differs from 1 by more than 0.001, and for a translation beyond
    /// [`MAX_MAGNITUDE`] on an axis.
    pub fn apply(&mut self, edit: &Edit) -> Result<bool, EditError> {
        let instance = edit.instance;
        if instance >= self.instances {
            return Err(EditError::Instance { instance, count: self.instances });
        }
        let before = self.overrides.get(&instance).copied().unwrap_or_default();
        let after = match edit.action {
            EditAction::Move { translation, rotation } => InstanceOverride {
                frame: Some(FrameOverride::new(instance, translation, rotation)?),
                ..before
            },
            EditAction::Release => InstanceOverride { frame: None, ..before },
            EditAction::Show => InstanceOverride { hidden: false, ..before },
            EditAction::Hide => InstanceOverride { hidden: true, ..before },
        };
        if after == InstanceOverride::default() {
            self.overrides.remove(&instance);
        } else {
            self.overrides.insert(instance, after);
        }
        Ok(after != before)
    }

    /// Returns the shortest list of edits that reproduces this state from an unedited scene, in the order of the
    /// instances. Late clients receive it.
    pub fn iter(&self) -> impl Iterator<Item = Edit> + '_ {
        self.overrides.iter().flat_map(|(&instance, change)| {
            let moved = change
                .frame
                .map(|FrameOverride { translation, rotation }| EditAction::Move { translation, rotation });
            let hidden = change.hidden.then_some(EditAction::Hide);
            moved.into_iter().chain(hidden).map(move |action| Edit { instance, action })
        })
    }

    /// Returns whether the scene is unedited.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.overrides.is_empty()
    }
}

impl FrameOverride {
    fn new(instance: u32, translation: [f32; 3], rotation: [f32; 4]) -> Result<Self, EditError> {
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        if !finite(&translation) {
            return Err(EditError::NotFinite { instance, what: "translation" });
        }
        if !finite(&rotation) {
            return Err(EditError::NotFinite { instance, what: "rotation" });
        }
        let length2: f32 = rotation.iter().map(|value| value * value).sum();
        if (length2 - 1.0).abs() > UNIT_TOLERANCE {
            return Err(EditError::Rotation { instance, rotation });
        }
        if translation.iter().any(|&axis| f64::from(axis).abs() > MAX_MAGNITUDE) {
            return Err(EditError::TooFar { instance, translation, limit_m: MAX_MAGNITUDE });
        }
        Ok(Self { translation, rotation })
    }

    fn rigid_frame(&self) -> RigidFrame {
        RigidFrame::unit(DQuat::from_array(self.rotation.map(f64::from)), Vec3::from(self.translation))
    }
}

impl ScenePose {
    /// Applies edits of the same scene on top of the animation. Call it once after every [`Scene::pose`] or
    /// [`Scene::pose_into`]; both start from the animation alone.
    ///
    /// [`Scene::pose`]: super::Scene::pose
    /// [`Scene::pose_into`]: super::Scene::pose_into
    pub fn apply(&mut self, edits: &Edits) {
        for (&instance, change) in &edits.overrides {
            let Some(slot) = self.instances.get_mut(instance as usize) else { break };
            if let Some(frame) = &change.frame {
                slot.frame = frame.rigid_frame();
            }
            slot.visible &= !change.hidden;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::Scene;

    const TURN: [f32; 4] = [0.0, 0.6, 0.0, 0.8];

    fn to(translation: [f32; 3]) -> EditAction {
        EditAction::Move { translation, rotation: TURN }
    }

    #[test]
    fn refused_edits_say_why_and_change_nothing() {
        let mut edits = Edits::new(3);
        edits.apply(&Edit { instance: 1, action: to([1.0, 2.0, 3.0]) }).unwrap();
        let before = edits.clone();
        let mut refuse = |instance, action| {
            let error = edits.apply(&Edit { instance, action }).unwrap_err();
            assert_eq!(edits, before);
            error
        };
        let none = refuse(3, EditAction::Hide);
        assert_eq!(none, EditError::Instance { instance: 3, count: 3 });
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(
                refuse(1, to([0.0, bad, 0.0])),
                EditError::NotFinite { instance: 1, what: "translation" }
            );
            let action = EditAction::Move { translation: [0.0; 3], rotation: [0.0, 0.0, bad, 1.0] };
            assert_eq!(refuse(1, action), EditError::NotFinite { instance: 1, what: "rotation" });
        }
        for far in [1e30, -1.1e9, f32::MAX] {
            assert!(matches!(refuse(1, to([0.0, 0.0, far])), EditError::TooFar { .. }), "{far}");
        }
        for rotation in [[0.0; 4], [0.0, 0.0, 0.0, 1.1], [f32::MAX; 4]] {
            let action = EditAction::Move { translation: [0.0; 3], rotation };
            assert_eq!(refuse(1, action), EditError::Rotation { instance: 1, rotation });
        }
        assert!(edits.apply(&Edit { instance: 1, action: to([0.0, 0.0, -1e9]) }).unwrap());
    }

    #[test]
    fn a_moved_walker_walks_on_elsewhere() {
        let scene = Scene::load("colonnade").unwrap();
        let walker =
            scene.instances().iter().position(|i| i.motion() == crate::scene::Motion::Deforming).unwrap();
        let mut edits = Edits::new(scene.instances().len() as u32);
        let instance = walker as u32;
        edits.apply(&Edit { instance, action: to([5.0, 6.0, 7.0]) }).unwrap();
        let mut pose = scene.pose(0.4);
        pose.apply(&edits);
        let (at, plain) = (&pose.instances()[walker], scene.pose(0.4));
        assert_eq!((at.frame().translation, at.visible()), (Vec3::new(5.0, 6.0, 7.0), true));
        assert!((at.frame().vector(Vec3::X) - Vec3::new(0.28, 0.0, -0.96)).length() < 1e-6);
        assert_eq!(at.deformation(), plain.instances()[walker].deformation());
        edits.apply(&Edit { instance, action: EditAction::Hide }).unwrap();
        edits.apply(&Edit { instance, action: EditAction::Release }).unwrap();
        scene.pose_into(0.4, &mut pose);
        assert_eq!(pose, plain, "posing starts from the animation");
        pose.apply(&edits);
        assert!(!pose.instances()[walker].visible());
        assert_eq!(pose.instances()[walker].frame(), plain.instances()[walker].frame());
    }

    fn action() -> impl Strategy<Value = EditAction> {
        prop_oneof![
            (0_u8..3).prop_map(|x| to([f32::from(x), 0.0, 0.0])),
            Just(EditAction::Release),
            Just(EditAction::Show),
            Just(EditAction::Hide),
        ]
    }

    proptest! {
        #[test]
        fn the_newest_wins_and_the_list_rebuilds_the_state(
            list in prop::collection::vec((0_u32..4, action()), 0..40),
        ) {
            let mut edits = Edits::new(4);
            // The reference keeps only the latest pose and the latest visibility.
            let mut plain = [(None, false); 4];
            for (instance, action) in list {
                let slot = &mut plain[instance as usize];
                let before = *slot;
                match action {
                    EditAction::Move { translation, .. } => slot.0 = Some(translation),
                    EditAction::Release => slot.0 = None,
                    EditAction::Show => slot.1 = false,
                    EditAction::Hide => slot.1 = true,
                }
                prop_assert_eq!(edits.apply(&Edit { instance, action }), Ok(*slot != before));
            }
            let words: usize = plain.iter().map(|(moved, hidden)| usize::from(moved.is_some()) + usize::from(*hidden)).sum();
            prop_assert_eq!(edits.iter().count(), words);
            prop_assert_eq!(edits.is_empty(), words == 0);
            let mut again = Edits::new(4);
            for edit in edits.iter() {
                prop_assert_eq!(again.apply(&edit), Ok(true));
            }
            prop_assert_eq!(again, edits);
        }
    }
}
