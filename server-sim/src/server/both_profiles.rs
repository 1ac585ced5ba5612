//! Both profiles at once, fed by one tracing: what they cost and how far off they are, on the same values.

use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::paper::Placement;
use psao_codec::surface;
use psao_proto::message::CameraPose;
use psao_proto::{Profile, SceneTable};

use super::field::TracedPoint;
use super::stats::Lap;
use super::trace_state::TraceState;
use super::traced_frame::{EncoderNeeds, TracedFrame, blocks_in_view};
use super::{EncodeStage, ProgressFn, Server, ServerError, ServerSettings, StepOutput, profile};
use crate::clock::Clock;
use crate::points::PointCache;
use crate::scene::Scene;
use crate::world::SceneBvh;

/// A value for each profile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PerProfile<T> {
    /// Of profile `paper`.
    pub paper: T,
    /// Of profile `surface`.
    pub surface: T,
}

/// A server of both profiles. The bytes of each are those that a [`Server`] of that profile alone writes.
pub struct BothProfiles {
    state: TraceState,
    encode: PerProfile<EncodeStage>,
}

/// How far what clients hold is from the AO as it was traced: neither rounded nor held back by a threshold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AoErrorStats {
    /// Points compared: those in view that the client holds.
    pub points: u64,
    /// Points in view that the client does not hold, left out of the rest.
    pub lost: u64,
    /// Sum of the differences, in 255ths.
    pub sum: f64,
    /// Sum of their squares.
    pub squares: f64,
    /// The largest of them.
    pub max: f64,
}

impl AoErrorStats {
    /// Adds a point: what the client holds, if anything, and what was traced, 0 to 1.
    fn add(&mut self, held: Option<u8>, exact: f32) {
        let Some(held) = held else {
            self.lost += 1;
            return;
        };
        let off = (f64::from(held) - f64::from(exact) * 255.0).abs();
        self.points += 1;
        self.sum += off;
        self.squares += off * off;
        self.max = self.max.max(off);
    }

    /// Adds the points of another frame.
    pub fn merge(&mut self, other: &Self) {
        self.points += other.points;
        self.lost += other.lost;
        self.sum += other.sum;
        self.squares += other.squares;
        self.max = self.max.max(other.max);
    }

    /// Mean difference, in 255ths; 0 without points.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.sum / self.points.max(1) as f64
    }

    /// Root of the mean squared difference, in 255ths; 0 without points.
    #[must_use]
    pub fn rms(&self) -> f64 {
        (self.squares / self.points.max(1) as f64).sqrt()
    }
}

impl BothProfiles {
    /// As [`Server::with_cache`], for both profiles; `settings.profile` counts for nothing, `settings.coder` for `paper`.
    ///
    /// # Errors
    /// As [`Server::new`].
    pub fn new(
        scene: Arc<Scene>,
        settings: &ServerSettings,
        surface_coder: BlockCoder,
        cache: Option<&dyn PointCache>,
        progress: Arc<ProgressFn>,
    ) -> Result<Self, ServerError> {
        let surface =
            ServerSettings { profile: Profile::SURFACE, coder: surface_coder, quality: 0.0, ..*settings };
        let Server { trace, encode } = Server::build(scene, surface, cache, progress, true)?;
        let mut state = trace.state;
        let paper = ServerSettings { profile: Profile::PAPER, ..*settings };
        paper.validate()?;
        let paper = profile::encode_stage(&state.scene, &mut state.points, &paper)?;
        Ok(Self { state, encode: PerProfile { paper, surface: encode } })
    }

    /// What clients are told first.
    #[must_use]
    pub fn tables(&self) -> PerProfile<&Arc<SceneTable>> {
        PerProfile { paper: self.encode.paper.table(), surface: self.encode.surface.table() }
    }

    /// The scene as of the last step.
    #[must_use]
    pub fn world(&self) -> &SceneBvh {
        &self.state.world
    }

    /// Computes one frame as [`Server::step`] does: traces once, then writes it in both profiles.
    ///
    /// # Errors
    /// As [`Server::step`].
    pub fn step(
        &mut self,
        index: FrameIndex,
        time: StreamTime,
        cameras: &[CameraPose],
        clock: &dyn Clock,
    ) -> Result<PerProfile<StepOutput>, ServerError> {
        let mut lap = Lap::new(clock);
        let first = self.encode.paper.state().frame().is_none();
        let traces = self.state.advance((index, time), cameras, first, &mut lap);
        let state = &self.state;
        let mut write = |stage: &mut EncodeStage| {
            let traced = TracedFrame::new(state, traces, EncoderNeeds::of(&stage.encoder));
            stage.encode_lap(traced, &mut lap)
        };
        let paper = write(&mut self.encode.paper)?;
        let surface = write(&mut self.encode.surface)?;
        Ok(PerProfile { paper, surface })
    }

    /// Keyframes of the last step's state, as [`Server::keyframe`].
    ///
    /// # Errors
    /// As [`Server::keyframe`].
    pub fn keyframes(
        &self,
        frame: FrameIndex,
        time: StreamTime,
        coders: PerProfile<BlockCoder>,
    ) -> Result<PerProfile<Vec<u8>>, ServerError> {
        let first = blocks_in_view(&self.state, &self.state.cameras);
        let Self { encode: PerProfile { paper, surface }, .. } = self;
        Ok(PerProfile {
            paper: paper.encoder.keyframe(frame, time, coders.paper, &first)?,
            surface: surface.encoder.keyframe(frame, time, coders.surface, &first)?,
        })
    }

    /// Error of what clients hold after the last step, over the points in view that a picture needs. For `surface` that is
    /// what `client` says; for `paper`, what the points were sent as that have a slot in the client's tables.
    #[must_use]
    pub fn errors(&self, client: &surface::State) -> PerProfile<AoErrorStats> {
        let mut errors = PerProfile::<AoErrorStats>::default();
        let TraceState { field, points, .. } = &self.state;
        for chunk in field.chunks() {
            let numbers = self.state.numbers(chunk.instance);
            let held = client.values(chunk.instance as u32);
            for TracedPoint { place, id, buried, .. } in field.visible(chunk).filter(|point| point.seen) {
                let place = place.index();
                let Some(exact) = field.exact(id) else { continue };
                let here = client.is_present(chunk.instance as u32, place / surface::BLOCK_POINTS);
                // A buried point has no value at either end.
                if !buried {
                    errors.surface.add(held.get(place).copied().filter(|_| here), exact);
                }
                if let Some(encoder) = self.encode.paper.encoder.as_paper() {
                    let number = points.offsets()[chunk.instance] + numbers[place];
                    let stored = encoder.placement(number) == Some(Placement::Stored);
                    errors.paper.add(encoder.sent_ao(number).filter(|_| stored), exact);
                }
            }
        }
        errors
    }
}

impl std::fmt::Debug for BothProfiles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { state, .. } = self;
        f.debug_struct("BothProfiles")
            .field("scene", &state.scene.name())
            .field("points", &state.points.total())
            .finish_non_exhaustive()
    }
}
