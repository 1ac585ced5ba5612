//! EDIT: a change of one instance of the scene.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, finite, require};
use crate::FrameType;

/// Change of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub enum EditAction {
    /// Replaces the instance's animation by a fixed pose until the instance is released.
    Move {
        /// Translation from local to world space, metres.
        translation: [f32; 3],
        /// Rotation from local to world space, a unit quaternion x, y, z, w.
        rotation: [f32; 4],
    },
    /// Returns the instance to its animation.
    Release,
    /// Shows the instance: it is drawn and casts occlusion.
    Show,
    /// Hides the instance: it is not drawn and casts no occlusion.
    Hide,
}

/// Changes one instance of the scene. A client sends it as a request, which a server may ignore without an answer. A
/// server sends it for an edit that every later frame includes.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Edit {
    /// Index of the instance in the scene table.
    pub instance: u32,
    /// The change.
    pub action: EditAction,
}

impl Payload for Edit {
    fn check(&self) -> Result<(), FieldError> {
        let EditAction::Move { translation, rotation } = &self.action else {
            return Ok(());
        };
        finite(translation, "translation")?;
        finite(rotation, "rotation")?;
        let length2: f32 = rotation.iter().map(|v| v * v).sum();
        require((length2 - 1.0).abs() <= 1e-3, "rotation", "is not a unit quaternion")
    }
}

impl Message for Edit {
    const KIND: FrameType = FrameType::EDIT;
    const NAME: &'static str = "EDIT";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let action = EditAction::Move { translation: [1.0, 0.0, -1.0], rotation: [0.0, 0.0, 0.0, 1.0] };
        golden(
            &Edit { instance: 7, action },
            "07000000 00000000 0000803f 00000000 000080bf 00000000 00000000 00000000 0000803f",
        );
        golden(&Edit { instance: 7, action: EditAction::Release }, "07000000 01000000");
        golden(&Edit { instance: 7, action: EditAction::Show }, "07000000 02000000");
        golden(&Edit { instance: 7, action: EditAction::Hide }, "07000000 03000000");
        for rotation in [[0.0; 4], [f32::NAN; 4], [0.0, 0.0, 0.0, 1.1]] {
            let action = EditAction::Move { translation: [0.0; 3], rotation };
            assert!(Edit { instance: 0, action }.to_payload().is_err());
        }
    }
}
