//! What is streamed: the sample that needs no scene, or a recording.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::EncodedFrame;
use psao_proto::recording::{Player, PlayerEvent};
use psao_proto::sample::SampleServer;
use psao_proto::{Limits, Profile, SceneTable};

use crate::LabError;

/// Something that makes one frame after the other.
pub trait Source {
    /// Returns the scene table.
    fn scene(&self) -> &Arc<SceneTable>;
    /// Returns the block coder of its frames, for keyframes and patches.
    fn coder(&self) -> BlockCoder;
    /// Returns the next frame; `None` at the end.
    ///
    /// # Errors
    /// [`LabError::Source`] when it cannot go on.
    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError>;
    /// Returns the state after the last frame; `None` before the first.
    fn state(&self) -> Option<StateRef<'_>>;
}

/// The sample: endless, a few points.
#[derive(Debug)]
pub struct SampleSource(SampleServer);

impl SampleSource {
    /// Of a profile.
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

/// The frames of a recording, up to its end; what is damaged in it is left out and counted.
#[derive(Debug)]
pub struct RecordingSource<'a> {
    file: &'a [u8],
    player: Player<'a>,
    scene: Arc<SceneTable>,
    coder: BlockCoder,
}

impl<'a> RecordingSource<'a> {
    /// Of the bytes of a whole file.
    ///
    /// # Errors
    /// [`LabError::Source`] when the bytes are no recording, or hold no scene table.
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

    /// Frames and stretches of the file that were left out so far.
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
