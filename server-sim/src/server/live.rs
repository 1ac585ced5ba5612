//! The live loop: one frame is traced while the one before is encoded and sent. Behind the feature `live`.
//!
//! This is the only part of the server that starts a thread of its own and reads a clock.

use std::fmt;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_proto::Micros;
use psao_proto::message::{CameraPose, Edit};
use psao_proto::sinks::{SinkError, Sinks};

use super::{
    EncodeStage, FrameStats, FrameTimeController, RayBacklog, RayBudget, Server, ServerError, StepOutput,
    TraceStage, TracedFrame,
};
use crate::clock::Clock;
use crate::scene::EditError;

/// How a [`Pipeline`] runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PipelineSettings {
    /// Time that a frame may take. The number of rays follows from it; `None` leaves it as the server's settings say.
    pub frame_time: Option<Micros>,
    /// Whether a report with the times of the stages goes with every frame.
    pub timings: bool,
}

impl PipelineSettings {
    /// Sets [`frame_time`](Self::frame_time).
    #[must_use]
    pub fn with_frame_time(mut self, frame_time: Option<Micros>) -> Self {
        self.frame_time = frame_time;
        self
    }

    /// Sets [`timings`](Self::timings).
    #[must_use]
    pub fn with_timings(mut self, timings: bool) -> Self {
        self.timings = timings;
        self
    }
}

/// A live server: traces frames, and on a thread of its own encodes the one before and gives it to the [`Sinks`].
///
/// Frames are sent in order, none left out. [`frame`](Self::frame) waits when two frames are on their way: more would only be
/// older when they arrive.
pub struct Pipeline {
    trace: TraceStage,
    clock: SystemClock,
    /// Edits in the scene that are not in a frame yet.
    edits: Vec<Edit>,
    /// Plans the rays of frames; `None` without a frame time.
    controller: Option<FrameTimeController>,
    late: LatePoints,
    frames: SyncSender<Queued>,
    encoder: JoinHandle<Result<Sinks, PipelineError>>,
}

/// Points that had to wait for rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LatePoints {
    /// Frames in which some did.
    pub frames: u64,
    /// The most of one frame.
    pub points: u32,
    /// Frames that one waited at most.
    pub oldest: u16,
}

/// Why a live server cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The system gave no thread to encode with.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
    /// The encoder's thread ended early. [`Pipeline::finish`] says why.
    #[error("frames cannot be sent any more")]
    Stopped,
    /// The encoder's thread panicked.
    #[error("the encoder's thread failed")]
    Failed,
    /// A frame could not be encoded.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// A frame could not be sent or recorded.
    #[error(transparent)]
    Sink(#[from] SinkError),
}

/// A frame to be encoded and sent.
struct Queued {
    /// What happened to the scene before it.
    edits: Vec<Edit>,
    traced: TracedFrame,
    captured: Micros,
}

impl Pipeline {
    /// Starts the encoder's thread; frames go to `sinks`.
    ///
    /// # Errors
    /// [`PipelineError::Thread`].
    pub fn new(server: Server, sinks: Sinks, settings: PipelineSettings) -> Result<Self, PipelineError> {
        let (trace, encode) = server.into_stages();
        let (frames, queue) = sync_channel(1);
        let clock = SystemClock::start();
        let encoder = Encoder { encode, sinks, clock, timings: settings.timings };
        let encoder = std::thread::Builder::new()
            .name("encoder".into())
            .spawn(move || encoder.run(&queue))
            .map_err(PipelineError::Thread)?;
        let controller = settings.frame_time.map(|Micros(micros)| FrameTimeController::new(micros));
        Ok(Self { trace, clock, edits: Vec::new(), controller, late: LatePoints::default(), frames, encoder })
    }

    /// Changes the scene from the next frame on, as [`TraceStage::edit`]; the sinks are told with that frame.
    ///
    /// # Errors
    /// As [`TraceStage::edit`].
    pub fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        let changed = self.trace.edit(edit)?;
        if changed {
            self.edits.push(*edit);
        }
        Ok(changed)
    }

    /// Traces a frame as [`Server::step`] does, and has it encoded and sent. `captured` is the time that it shows, by
    /// [`Sinks::now`].
    ///
    /// # Errors
    /// [`PipelineError::Stopped`] when an earlier frame could not be encoded or sent.
    pub fn frame(
        &mut self,
        index: FrameIndex,
        time: StreamTime,
        views: &[CameraPose],
        captured: Micros,
    ) -> Result<(), PipelineError> {
        if let Some(rays) = self.controller.as_ref().and_then(FrameTimeController::rays) {
            self.trace.state.ray_budget = Some(RayBudget { rays, longest_age: RayBudget::LONGEST_AGE });
        }
        let traced = self.trace.trace(index, time, views, &self.clock);
        self.learn(&traced.stats());
        let edits = std::mem::take(&mut self.edits);
        self.frames.send(Queued { edits, traced, captured }).map_err(|_| PipelineError::Stopped)
    }

    fn learn(&mut self, stats: &FrameStats) {
        if let Some(controller) = &mut self.controller {
            controller.learn(stats);
        }
        if let Some(RayBacklog { points: points @ 1.., oldest }) = stats.waiting {
            self.late.frames += 1;
            self.late.points = self.late.points.max(points);
            self.late.oldest = self.late.oldest.max(oldest);
        }
    }

    /// Returns the points that had to wait for rays so far.
    #[must_use]
    pub fn late_points(&self) -> LatePoints {
        self.late
    }

    /// Sends what is on its way; returns the sinks, and the points that had to wait for rays.
    ///
    /// # Errors
    /// What stopped the encoder's thread.
    pub fn finish(self) -> Result<(Sinks, LatePoints), PipelineError> {
        drop(self.frames);
        let sinks = self.encoder.join().map_err(|_| PipelineError::Failed)??;
        Ok((sinks, self.late))
    }
}

impl fmt::Debug for Pipeline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pipeline")
            .field("trace", &self.trace)
            .field("late", &self.late)
            .finish_non_exhaustive()
    }
}

/// What runs on the encoder's thread.
struct Encoder {
    encode: EncodeStage,
    sinks: Sinks,
    clock: SystemClock,
    timings: bool,
}

impl Encoder {
    /// Encodes and sends frames until no more come.
    fn run(mut self, queue: &Receiver<Queued>) -> Result<Sinks, PipelineError> {
        for Queued { edits, traced, captured } in queue {
            edits.iter().try_for_each(|edit| self.sinks.edit(edit))?;
            let StepOutput { body, info, stats, budget } = self.encode.encode(traced, &self.clock)?;
            let (encode, sinks) = (&self.encode, &mut self.sinks);
            let keyframe = || encode.keyframe(info.frame, info.time, encode.coder());
            sinks.frame(&info, body, encode.state(), captured, keyframe)?;
            if let Some(budget) = &budget {
                sinks.budget(budget)?;
            }
            if self.timings {
                sinks.report(&stats.report(info.frame, true))?;
            }
        }
        Ok(self.sinks)
    }
}

/// The system's clock, since a start.
#[derive(Clone, Copy, Debug)]
struct SystemClock(Instant);

impl SystemClock {
    fn start() -> Self {
        Self(Instant::now())
    }
}

impl Clock for SystemClock {
    fn micros(&self) -> u64 {
        u64::try_from(self.0.elapsed().as_micros()).unwrap_or(u64::MAX)
    }
}
