//! The encoder, for either profile.

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use crate::paper::{self, Occupancy, PointError, PointSample, Pose, PoseError};
use crate::surface::{self, Postponed};
use crate::{StateRef, keyframe};

/// Decides which points a frame sends, and writes the frame. A server gives it every traced value, frame by frame.
#[derive(Debug)]
pub enum Encoder {
    /// A stream of profile `paper`. With a threshold ([`paper::Encoder::with_threshold`]) it decides which points are
    /// sent.
    Paper(Box<paper::Encoder>),
    /// A stream of profile `surface`.
    Surface(Box<surface::Encoder>),
}

impl Encoder {
    /// Returns whether positions, normals and poses must be given. Profile `surface` needs none: its points stay on
    /// the mesh at rest, where clients know them. If places are needed, a point's id is its number in the order of
    /// creation. Otherwise it is the point's index in the geometry of its set. Both count from the first point of the
    /// instance.
    #[must_use]
    pub fn needs_places(&self) -> bool {
        matches!(self, Encoder::Paper(_))
    }

    /// Returns whether weights decide what a frame sends. Otherwise [`Encoder::set_weight`] has no effect.
    #[must_use]
    pub fn needs_weights(&self) -> bool {
        match self {
            Encoder::Paper(_) => false,
            Encoder::Surface(encoder) => encoder.settings().budget.is_some(),
        }
    }

    /// Sets the pose of an instance. It has no effect if [`Encoder::needs_places`] returns false.
    ///
    /// # Errors
    /// Those of [`paper::Encoder::set_pose`].
    pub fn set_pose(&mut self, instance: u32, pose: Pose) -> Result<(), PoseError> {
        match self {
            Encoder::Paper(encoder) => encoder.set_pose(instance, pose),
            Encoder::Surface(_) => Ok(()),
        }
    }

    /// Sets a point. Its place counts only if [`Encoder::needs_places`] returns true. `threshold` is the least
    /// difference that is sent, see [`surface::Encoder::set_ao_within`]; profile `paper` has one threshold for all
    /// points. Returns whether the next frame is to send the point.
    ///
    /// # Errors
    /// [`PointError`] if the point does not exist or its place is not finite.
    pub fn set_point(&mut self, point: u32, sample: &PointSample, threshold: u8) -> Result<bool, PointError> {
        match self {
            Encoder::Paper(encoder) => encoder.set_point(point, sample),
            Encoder::Surface(encoder) => {
                let count = encoder.state().layout().points();
                let set = encoder.set_ao_within(point, sample.ao, threshold);
                set.ok_or(PointError::Unknown { point, count })
            }
        }
    }

    /// Says that the AO of a point is no longer known, see [`surface::Encoder::release`]. It has no effect in profile
    /// `paper`.
    pub fn release(&mut self, point: u32) {
        if let Encoder::Surface(encoder) = self {
            encoder.release(point);
        }
    }

    /// Sets the weight of a point block within a byte budget, see [`surface::Encoder::set_weight`].
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        if let Encoder::Surface(encoder) = self {
            encoder.set_weight(instance, block, weight);
        }
    }

    /// Writes the frame that brings clients from the last frame to now.
    ///
    /// # Errors
    /// [`EncodeError`]; no change is lost, and the next call writes them all.
    pub fn finish(&mut self, meta: FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        match self {
            Encoder::Paper(encoder) => encoder.finish(meta, coder),
            Encoder::Surface(encoder) => encoder.finish(meta, coder),
        }
    }

    /// Writes the clients' state as a keyframe body. `first` names the blocks that go first, see [`keyframe`].
    ///
    /// # Errors
    /// Those of [`keyframe`].
    pub fn keyframe(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coder: BlockCoder,
        first: &[(u32, u32)],
    ) -> Result<Vec<u8>, EncodeError> {
        let changed_points = match self {
            Encoder::Paper(encoder) => encoder.counts().points_stored,
            Encoder::Surface(encoder) => u32::try_from(encoder.state().present_points()).unwrap_or(u32::MAX),
        };
        let meta = FrameMeta { kind: FrameKind::Key, frame, time, changed_points };
        keyframe(self.state(), meta, coder, first)
    }

    /// Returns the state of clients after the last frame.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        match self {
            Encoder::Paper(encoder) => encoder.state().into(),
            Encoder::Surface(encoder) => encoder.state().into(),
        }
    }

    /// Returns how full the tables of profile `paper` are; `None` for the other profile.
    #[must_use]
    pub fn occupancy(&self) -> Option<Occupancy> {
        self.as_paper().map(paper::Encoder::counts)
    }

    /// Returns what a byte budget postponed in the last frame; `None` without a budget.
    #[must_use]
    pub fn postponed(&self) -> Option<&Postponed> {
        self.as_surface()?.postponed()
    }

    /// Returns the heap bytes in use for the stream.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        match self {
            Encoder::Paper(encoder) => encoder.heap_bytes(),
            Encoder::Surface(encoder) => encoder.heap_bytes(),
        }
    }

    /// Returns the encoder of a `paper` stream; `None` for the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&paper::Encoder> {
        match self {
            Encoder::Paper(encoder) => Some(encoder),
            Encoder::Surface(_) => None,
        }
    }

    /// Returns the encoder of a `surface` stream; `None` for the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&surface::Encoder> {
        match self {
            Encoder::Paper(_) => None,
            Encoder::Surface(encoder) => Some(encoder),
        }
    }
}
