//! Rigid transforms of instances.

use bytemuck::{Pod, Zeroable};

/// Largest |length^2 - 1| of a valid rotation: far above `f32` rounding, far below a visible scale.
const UNIT_TOLERANCE: f32 = 1e-3;

/// Placement of an instance, from instance-local metres to world metres: `world = rotation * local + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Pose {
    /// World position of the local origin, metres.
    pub translation: [f32; 3],
    /// Unit quaternion, x y z w.
    pub rotation: [f32; 4],
}

/// Why a pose was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseError {
    /// The instance does not exist.
    #[error("pose of instance {instance}, the layout has {count}")]
    Instance {
        /// The instance.
        instance: u32,
        /// Number of instances.
        count: u32,
    },
    /// The translation is infinite or not a number.
    #[error("pose of instance {instance}: translation {translation:?} is not finite")]
    Translation {
        /// The instance.
        instance: u32,
        /// The translation given.
        translation: [f32; 3],
    },
    /// The rotation is not a unit quaternion.
    #[error("pose of instance {instance}: rotation {rotation:?} is not of unit length")]
    Rotation {
        /// The instance.
        instance: u32,
        /// The rotation given.
        rotation: [f32; 4],
    },
}

impl Default for Pose {
    fn default() -> Pose {
        Pose::IDENTITY
    }
}

impl Pose {
    /// No translation, no rotation: the pose of every instance in an empty state.
    pub const IDENTITY: Pose = Pose { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// Checks that the pose of `instance` is finite and the squared length of its rotation within 0.001 of 1.
    ///
    /// # Errors
    /// [`PoseError::Translation`] or [`PoseError::Rotation`].
    pub fn check(&self, instance: u32) -> Result<(), PoseError> {
        let Pose { translation, rotation } = *self;
        if !translation.iter().all(|axis| axis.is_finite()) {
            return Err(PoseError::Translation { instance, translation });
        }
        let length_squared: f32 = rotation.iter().map(|axis| axis * axis).sum();
        // Written so that NaN fails.
        if (length_squared - 1.0).abs() <= UNIT_TOLERANCE {
            return Ok(());
        }
        Err(PoseError::Rotation { instance, rotation })
    }

    /// Returns the seven words on the wire: translation, then rotation, as bits of `f32`.
    pub(crate) fn to_words(self) -> [u32; 7] {
        bytemuck::must_cast(self)
    }

    pub(crate) fn from_words(words: [u32; 7]) -> Pose {
        bytemuck::must_cast(words)
    }

    /// Returns the words for the state hash: the exclusive or of the wire words and those of the identity. So the
    /// identity counts as empty.
    pub(crate) fn hash_words(self) -> [u32; 7] {
        let mut words = self.to_words();
        words[6] ^= 1.0_f32.to_bits();
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_that_are_none_are_refused() {
        let pose = |translation, rotation| Pose { translation, rotation }.check(7);
        assert_eq!(pose([1e30, -5.0, 0.0], [0.5, 0.5, -0.5, 0.5]), Ok(()));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(matches!(
                pose([0.0, bad, 0.0], [0.0, 0.0, 0.0, 1.0]),
                Err(PoseError::Translation { instance: 7, .. })
            ));
            assert!(matches!(
                pose([0.0; 3], [bad, 0.0, 0.0, 1.0]),
                Err(PoseError::Rotation { instance: 7, .. })
            ));
        }
        for rotation in [[0.0; 4], [0.0, 0.0, 0.0, 1.001], [1e30; 4], [0.5; 4].map(|axis| axis * 0.99)] {
            assert_eq!(pose([0.0; 3], rotation), Err(PoseError::Rotation { instance: 7, rotation }));
        }
    }

    #[test]
    fn the_identity_counts_as_empty() {
        assert_eq!(Pose::IDENTITY.hash_words(), [0; 7]);
        assert_ne!(Pose { translation: [-0.0; 3], ..Pose::IDENTITY }.hash_words(), [0; 7]);
        let pose = Pose { translation: [1.0, 2.0, 3.0], rotation: [0.0, 0.6, 0.0, 0.8] };
        assert_eq!(Pose::from_words(pose.to_words()), pose);
    }
}
