//! Numbering the frames of a connection or recording by group and sequence.

use crate::framer::frame_head;
use crate::message::{Message, MessageError};
use crate::{FrameType, Group, HEADER_BYTES, SceneTable, Sequence, WireFrameError, write_frame};

/// Turns frame bodies and messages into numbered frames of one stream.
///
/// A server session has one for its client. A recorder at the server has its own, so a recording starts with the scene
/// table and group 1, whatever the clients do.
///
/// ```
/// use psao_proto::{Framer, Group, Limits, Numbering, Sequence};
///
/// let mut numbering = Numbering::default();
/// let mut framer = Framer::new(Limits::default());
/// for frame in [numbering.keyframe(b"k")?, numbering.update(b"u")?, numbering.keyframe(b"k")?] {
///     framer.push(&frame);
/// }
/// let mut places = Vec::new();
/// while let Some(frame) = framer.next_frame()? {
///     places.push((frame.header.group.0, frame.header.sequence.0));
/// }
/// assert_eq!(places, [(1, 0), (1, 1), (2, 0)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Numbering {
    group: Group,
    sequence: Sequence,
}

impl Numbering {
    /// Returns the KEYFRAME frame of a body. It opens the next group.
    ///
    /// # Errors
    /// [`WireFrameError::TooLong`] over 2^32 - 1 bytes.
    pub fn keyframe(&mut self, body: &[u8]) -> Result<Vec<u8>, WireFrameError> {
        self.open_group();
        self.frame(FrameType::KEYFRAME, body)
    }

    /// Returns the UPDATE frame of a body. It is the next in the group.
    ///
    /// # Errors
    /// As [`keyframe`](Self::keyframe).
    pub fn update(&mut self, body: &[u8]) -> Result<Vec<u8>, WireFrameError> {
        self.next_place();
        self.frame(FrameType::UPDATE, body)
    }

    /// Returns the header of a KEYFRAME frame, for a body that is not copied.
    pub(crate) fn keyframe_head(&mut self, body: &[u8]) -> Result<[u8; HEADER_BYTES], WireFrameError> {
        self.open_group();
        frame_head(FrameType::KEYFRAME, self.group, self.sequence, body)
    }

    /// Returns the header of an UPDATE frame, for a body that is not copied.
    pub(crate) fn update_head(&mut self, body: &[u8]) -> Result<[u8; HEADER_BYTES], WireFrameError> {
        self.next_place();
        frame_head(FrameType::UPDATE, self.group, self.sequence, body)
    }

    /// Returns the frame of a message. It repeats the numbers of the keyframe or update before it.
    ///
    /// # Errors
    /// [`MessageError`] when the message holds an invalid value.
    pub fn message<M: Message>(&self, message: &M) -> Result<Vec<u8>, MessageError> {
        Ok(self.control(M::KIND, &message.to_payload()?))
    }

    /// Returns the SCENE frames of a scene table.
    ///
    /// # Errors
    /// [`MessageError`] when the table holds an invalid value.
    pub fn scene(&self, scene: &SceneTable) -> Result<Vec<Vec<u8>>, MessageError> {
        Ok(scene.payloads()?.iter().map(|payload| self.control(FrameType::SCENE, payload)).collect())
    }

    const fn open_group(&mut self) {
        self.group = self.group.next();
        self.sequence = Sequence(0);
    }

    const fn next_place(&mut self) {
        self.sequence = self.sequence.next();
    }

    fn frame(self, kind: FrameType, payload: &[u8]) -> Result<Vec<u8>, WireFrameError> {
        let mut out = Vec::new();
        write_frame(&mut out, kind, self.group, self.sequence, payload)?;
        Ok(out)
    }

    /// Returns a frame that is neither keyframe nor update, with `payload` unchanged. A control message has at most 64
    /// KiB, so its length always fits.
    pub(crate) fn control(self, kind: FrameType, payload: &[u8]) -> Vec<u8> {
        self.frame(kind, payload).unwrap_or_default()
    }
}
