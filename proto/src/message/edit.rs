//! EDIT: a client changes the scene.

use bincode::{Decode, Encode};

use super::sealed::Payload;
use super::{FieldError, Message, finite, require};
use crate::FrameType;

/// What happens to an instance.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub enum EditAction {
    /// It gets a pose of its own, in place of its animation's, until it is released.
    Move {
        /// Local to world, metres.
        translation: [f32; 3],
        /// Local to world, unit quaternion x, y, z, w.
        rotation: [f32; 4],
    },
    /// It follows its animation again.
    Release,
    /// It is drawn and casts occlusion.
    Show,
    /// It is neither drawn nor casts occlusion.
    Hide,
}

/// Changes one instance of the scene. A server of this version may ignore it, and answers nothing.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Edit {
    /// Index of the instance in the scene table.
    pub instance: u32,
    /// What happens to it.
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
