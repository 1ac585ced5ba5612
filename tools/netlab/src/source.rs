//! Sources of frames: a sample that needs no scene, or a recording.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::EncodedFrame;
use psao_proto::recording::{Player, PlayerEvent};
use psao_proto::sample::SampleServer;
use psao_proto::{Limits, Profile, SceneTable};

use crate::LabError;

/// A producer of frames.
pub trait Source {
    /// Returns the scene table.
    fn scene(&self) -> &Arc<SceneTable>;
    /// Returns the block coder for keyframes and patches of this stream.
    fn coder(&self) -> BlockCoder;
    /// Returns the next frame; `None` at the end.
    ///
    /// # Errors
    /// [`LabError::Source`] when the source fails.
    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError>;
    /// Returns the state after the last frame; `None` before the first.
    fn state(&self) -> Option<StateRef<'_>>;
}

/// The built-in sample stream of a few points. It has no end.
#[derive(Debug)]
pub struct SampleSource(SampleServer);

impl SampleSource {
    /// Creates a sample stream of `profile`.
    ///
    /// # Errors
    /// [`LabError::Source`] for a profile that is neither `paper` nor `surface`.
    pub fn new(profile: Profile) -> Result<Self, LabError> {
        SampleServer::of(profile).map(Self).map_err(|error| LabError::Source(error.to_string()))
    }
}

impl Source for SampleSource {
    fn scene(&self) -> &Arc<SceneTable> {
        self.0.scene()
    }

    fn coder(&self) -> BlockCoder {
        self.0.coder()
    }

    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError> {
        self.0.step().map(Some).map_err(|error| LabError::Source(error.to_string()))
    }

    fn state(&self) -> Option<StateRef<'_>> {
        self.0.state().frame().map(|_| self.0.state().into())
    }
}

/// The frames of a recording. Damaged parts are skipped and counted.
#[derive(Debug)]
pub struct RecordingSource<'a> {
    file: &'a [u8],
    player: Player<'a>,
    scene: Arc<SceneTable>,
    coder: BlockCoder,
}

impl<'a> RecordingSource<'a> {
    /// Creates a source from the bytes of a whole file.
    ///
    /// # Errors
    /// [`LabError::Source`] when the bytes are not a recording, or hold no scene table.
    pub fn new(file: &'a [u8]) -> Result<Self, LabError> {
        let mut player = Player::new(file, Limits::default()).map_err(|e| LabError::Source(e.to_string()))?;
        let scene = loop {
            match player.next_event() {
                Some(PlayerEvent::Scene(scene)) => break scene,
                Some(_) => {}
                None => {
                    let text = "it has no whole scene table, so no client could follow it";
                    return Err(LabError::Source(text.to_owned()));
                }
            }
        };
        let coder = BlockCoder::of(scene.info().coder);
        Ok(Self { file, player, scene, coder })
    }

    /// Returns the number of frames and damaged stretches that were skipped so far.
    #[must_use]
    pub const fn left_out(&self) -> u64 {
        let stats = self.player.stats();
        stats.damages + stats.unusable + stats.bad_messages
    }
}

impl Source for RecordingSource<'_> {
    fn scene(&self) -> &Arc<SceneTable> {
        &self.scene
    }

    fn coder(&self) -> BlockCoder {
        self.coder
    }

    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError> {
        while let Some(event) = self.player.next_event() {
            if let PlayerEvent::Frame(frame) = event {
                let body = frame.body(self.file).to_vec();
                return Ok(Some(EncodedFrame { info: frame.info, body }));
            }
        }
        Ok(None)
    }

    fn state(&self) -> Option<StateRef<'_>> {
        self.player.state().filter(|state| state.frame().is_some()).map(Into::into)
    }
}
