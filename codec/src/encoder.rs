//! Writes the frames of a stream of either profile.

use crate::block::BlockCoder;
use crate::envelope::{EncodeError, EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use crate::paper::{self, Occupancy, PointError, PointSample, Pose, PoseError};
use crate::surface::{self, Postponed};
use crate::{StateRef, keyframe};

/// Decides which points a frame sends, and writes it. A server gives it everything that it traced, frame by frame.
#[derive(Debug)]
pub enum Encoder {
    /// Of profile `paper`; made with a threshold ([`paper::Encoder::with_threshold`]) it decides what is sent.
    Paper(Box<paper::Encoder>),
    /// Of profile `surface`.
    Surface(Box<surface::Encoder>),
}

impl Encoder {
    /// Whether positions, normals and poses must be given: not where points stay on the mesh at rest, whose places clients
    /// know. Where they must, a point's id is its number in the order of making; else its place in its set's geometry. Both are
    /// counted from the first point of its instance.
    #[must_use]
    pub fn needs_places(&self) -> bool {
        matches!(self, Encoder::Paper(_))
    }

    /// Whether weights decide what a frame sends: [`Encoder::set_weight`] is without effect elsewhere.
    #[must_use]
    pub fn needs_weights(&self) -> bool {
        match self {
            Encoder::Paper(_) => false,
            Encoder::Surface(encoder) => encoder.settings().budget.is_some(),
        }
    }

    /// Sets the pose of an instance; without effect where [`Encoder::needs_places`] says no.
    ///
    /// # Errors
    /// As [`paper::Encoder::set_pose`].
    pub fn set_pose(&mut self, instance: u32, pose: Pose) -> Result<(), PoseError> {
        match self {
            Encoder::Paper(encoder) => encoder.set_pose(instance, pose),
            Encoder::Surface(_) => Ok(()),
        }
    }

    /// Says what a point is now; its place counts only where [`Encoder::needs_places`] says so. Whether the next frame is to
    /// send it.
    ///
    /// # Errors
    /// [`PointError`] for a point that is not there, or a place that is not finite.
    pub fn set_point(&mut self, point: u32, sample: &PointSample) -> Result<bool, PointError> {
        match self {
            Encoder::Paper(encoder) => encoder.set_point(point, sample),
            Encoder::Surface(encoder) => {
                let count = encoder.state().layout().points();
                encoder.set_ao(point, sample.ao).ok_or(PointError::Unknown { point, count })
            }
        }
    }

    /// Sets how much a block of points counts within a byte budget, as [`surface::Encoder::set_weight`].
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        if let Encoder::Surface(encoder) = self {
            encoder.set_weight(instance, block, weight);
        }
    }

    /// Writes the frame that brings clients from the last frame to now.
    ///
    /// # Errors
    /// [`EncodeError`]; no change is lost then, the next call writes it.
    pub fn finish(&mut self, meta: FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        match self {
            Encoder::Paper(encoder) => encoder.finish(meta, coder),
            Encoder::Surface(encoder) => encoder.finish(meta, coder),
        }
    }

    /// Writes what clients hold as a keyframe body; `first` names what goes before all else, as [`keyframe`] says.
    ///
    /// # Errors
    /// As [`keyframe`].
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

    /// What clients hold after the last frame.
    #[must_use]
    pub fn state(&self) -> StateRef<'_> {
        match self {
            Encoder::Paper(encoder) => encoder.state().into(),
            Encoder::Surface(encoder) => encoder.state().into(),
        }
    }

    /// How full the tables of profile `paper` are; `None` for the other.
    #[must_use]
    pub fn occupancy(&self) -> Option<Occupancy> {
        self.as_paper().map(paper::Encoder::counts)
    }

    /// What a byte budget put off in the last frame; `None` without one.
    #[must_use]
    pub fn postponed(&self) -> Option<&Postponed> {
        self.as_surface()?.postponed()
    }

    /// Bytes of memory held for the stream.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        match self {
            Encoder::Paper(encoder) => encoder.heap_bytes(),
            Encoder::Surface(encoder) => encoder.heap_bytes(),
        }
    }

    /// The encoder of a `paper` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_paper(&self) -> Option<&paper::Encoder> {
        match self {
            Encoder::Paper(encoder) => Some(encoder),
            Encoder::Surface(_) => None,
        }
    }

    /// The encoder of a `surface` stream; `None` for one of the other profile.
    #[must_use]
    pub fn as_surface(&self) -> Option<&surface::Encoder> {
        match self {
            Encoder::Paper(_) => None,
            Encoder::Surface(encoder) => Some(encoder),
        }
    }
}
