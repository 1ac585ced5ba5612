//! Following a stream: applying keyframes and updates in order, and never to the wrong state.
//!
//! Live clients and players of recordings share it.

use psao_codec::envelope::{FrameBody, FrameError, FrameInfo, FrameKind};
use psao_codec::{Decoder, Layout, State};

use crate::{FrameHeader, FrameType, Group, Limits, Sequence};

/// Why a keyframe or update was not applied. The state stays unchanged until the next keyframe.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FollowError {
    /// Frames between the last one and this one are missing.
    #[error(
        "frames are missing: expected {expected_sequence} of group {expected_group}, found {found_sequence} of group {found_group}"
    )]
    Gap {
        /// Group of the expected frame.
        expected_group: Group,
        /// Sequence number of the expected frame.
        expected_sequence: Sequence,
        /// Group of the received frame.
        found_group: Group,
        /// Sequence number of the received frame.
        found_sequence: Sequence,
    },
    /// The body cannot be applied. A wrong state hash is [`FrameError::Hash`].
    #[error(transparent)]
    Body(#[from] FrameError),
    /// A KEYFRAME frame holds a delta, or an UPDATE frame holds a keyframe.
    #[error("a {frame} frame has a body of the other kind")]
    Kind {
        /// Type of the frame.
        frame: FrameType,
    },
    /// The scene table is missing or was damaged.
    #[error("the scene table before it is missing")]
    NoScene,
    /// No keyframe was applied yet, or an earlier frame of the group failed. Only a keyframe can be applied.
    #[error("it builds on a frame that was not applied; waiting for a keyframe")]
    Waiting,
}

/// The state of a stream, and the group and sequence number of its last frame.
#[derive(Debug)]
pub(crate) struct Follower {
    decoder: Decoder,
    state: State,
    /// Group and sequence number of the last frame applied; `None` while only a keyframe can be applied.
    position: Option<(Group, Sequence)>,
}

impl Follower {
    pub(crate) fn new(layout: &Layout) -> Self {
        Self { decoder: Decoder::new(), state: State::new(layout), position: None }
    }

    pub(crate) const fn state(&self) -> &State {
        &self.state
    }

    /// Returns whether the state is that of the last frame received.
    pub(crate) const fn is_current(&self) -> bool {
        self.position.is_some()
    }

    /// Refuses updates until the next keyframe.
    pub(crate) const fn lose_position(&mut self) {
        self.position = None;
    }

    /// Applies a KEYFRAME or UPDATE frame. `body` is the result of parsing its payload.
    pub(crate) fn follow(
        &mut self,
        header: FrameHeader,
        body: Result<FrameBody<'_>, FrameError>,
        limits: &Limits,
    ) -> Result<FrameInfo, FollowError> {
        let keyframe = header.kind == FrameType::KEYFRAME;
        if !keyframe {
            self.check_position(header)?;
        }
        // No frame may build on this one before it was applied.
        self.position = None;
        let kind = if keyframe { FrameKind::Key } else { FrameKind::Delta };
        let body = body?;
        if body.info().kind != kind {
            return Err(FollowError::Kind { frame: header.kind });
        }
        self.decoder.apply(&mut self.state, &body, &limits.codec)?;
        self.position = Some((header.group, header.sequence));
        Ok(body.into_info())
    }

    /// Applies a patch that arrived outside the frame order, as datagrams do. Returns the position in that order. After
    /// an error the state stays current.
    pub(crate) fn patch(
        &mut self,
        body: &FrameBody<'_>,
        limits: &Limits,
    ) -> Result<(Group, Sequence), FollowError> {
        let position = self.position.ok_or(FollowError::Waiting)?;
        if body.info().kind != FrameKind::Delta {
            return Err(FollowError::Kind { frame: FrameType::UPDATE });
        }
        self.decoder.apply(&mut self.state, body, &limits.codec)?;
        Ok(position)
    }

    /// Returns whether an UPDATE is no newer than a patch that was applied outside the frame order. The UPDATE is then
    /// skipped and counts as applied for the frame order.
    pub(crate) fn skip_superseded(&mut self, header: FrameHeader, body: &FrameBody<'_>) -> bool {
        let follows = |(group, sequence): (Group, Sequence)| {
            header.kind == FrameType::UPDATE && (group, sequence.next()) == (header.group, header.sequence)
        };
        let info = body.info();
        let old = self.position.is_some_and(follows)
            && info.kind == FrameKind::Delta
            && Some(info.frame) <= self.state.frame();
        if old {
            self.position = Some((header.group, header.sequence));
        }
        old
    }

    fn check_position(&mut self, header: FrameHeader) -> Result<(), FollowError> {
        let Some((expected_group, last)) = self.position else {
            return Err(FollowError::Waiting);
        };
        let (expected_sequence, found_group, found_sequence) = (last.next(), header.group, header.sequence);
        if (expected_group, expected_sequence) == (found_group, found_sequence) {
            return Ok(());
        }
        self.position = None;
        Err(FollowError::Gap { expected_group, expected_sequence, found_group, found_sequence })
    }
}
