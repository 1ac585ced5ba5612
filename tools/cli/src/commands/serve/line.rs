//! From the scene to the clients: tracing, and beside it, one frame behind, writing and sending.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use psao_proto::Micros;
use psao_proto::message::{CameraPose, Edit};
use psao_server::scene::EditError;
use psao_server::server::{FrameStats, FrameTimeController, RayBacklog, TracedFrame};

use super::outlet::Outlet;
use crate::context::Stopwatch;
use crate::error::{Exit, Failure, Outcome};
use crate::producer::{Back, Front, Producer};

/// What makes the frames and sends them.
pub(super) struct Line {
    stages: Stages,
    clock: Stopwatch,
    /// Edits in the scene that are not in a frame yet.
    edits: Vec<Edit>,
    /// Finds out how many rays there is time for; nothing where there is no hurry.
    pacing: Option<FrameTimeController>,
    late: Late,
}

/// Points that had to wait for rays.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Late {
    /// Frames in which some did.
    pub(super) frames: u64,
    /// The most of one frame.
    pub(super) points: u32,
    /// Frames that one waited at most.
    pub(super) oldest: u16,
}

enum Stages {
    /// One after the other.
    Whole(Box<Producer>, Outlet),
    /// Side by side.
    Halves { front: Box<Front>, jobs: SyncSender<Job>, writer: JoinHandle<Outcome<Outlet>> },
}

/// A frame to be written and sent.
struct Job {
    /// What happened to the scene before it.
    edits: Vec<Edit>,
    traced: TracedFrame,
    captured: Micros,
}

impl Line {
    /// Sets up the stages. `pacing` plans the rays of frames.
    pub(super) fn new(
        producer: Producer,
        outlet: Outlet,
        pacing: Option<FrameTimeController>,
    ) -> Outcome<Self> {
        let stages = match producer.split() {
            Err(producer) => Stages::Whole(producer, outlet),
            Ok((front, back)) => {
                // One frame may wait while one is written: more would only be older when they arrive.
                let (jobs, queue) = sync_channel(1);
                let writer = std::thread::Builder::new()
                    .name("writer".into())
                    .spawn(move || write(back, outlet, &queue))
                    .map_err(|error| {
                        Failure::new(Exit::System, format_args!("cannot start a thread: {error}"))
                    })?;
                Stages::Halves { front: Box::new(front), jobs, writer }
            }
        };
        Ok(Self { stages, clock: Stopwatch::start(), edits: Vec::new(), pacing, late: Late::default() })
    }

    /// Changes the scene from the next frame on; says whether it changed anything.
    pub(super) fn edit(&mut self, edit: &Edit) -> Result<bool, EditError> {
        let changed = match &mut self.stages {
            Stages::Whole(producer, _) => producer.edit(edit),
            Stages::Halves { front, .. } => front.edit(edit),
        }?;
        if changed {
            self.edits.push(*edit);
        }
        Ok(changed)
    }

    /// Traces a frame and sends it, or has it sent.
    pub(super) fn frame(&mut self, number: u32, views: &[CameraPose], captured: Micros) -> Outcome {
        let rays = self.pacing.as_ref().and_then(FrameTimeController::rays);
        let edits = std::mem::take(&mut self.edits);
        let stats = match &mut self.stages {
            Stages::Whole(producer, outlet) => {
                rays.map_or(Ok(()), |rays| producer.set_rays(rays))?;
                edits.iter().try_for_each(|edit| outlet.announce(edit))?;
                let (output, produced) = producer.step(number, views, &self.clock)?;
                let stats = output.stats;
                outlet
                    .send((output, &produced), producer.state(), captured, |info| producer.keyframe(info))?;
                stats
            }
            Stages::Halves { front, jobs, .. } => {
                rays.map_or(Ok(()), |rays| front.set_rays(rays))?;
                let traced = front.trace(number, views, &self.clock);
                let stats = traced.stats();
                // Without a receiver the writer has failed: it says why when it is joined.
                if jobs.send(Job { edits, traced, captured }).is_err() {
                    return Err(Failure::new(Exit::System, "frames cannot be sent any more"));
                }
                stats
            }
        };
        self.learn(&stats);
        Ok(())
    }

    fn learn(&mut self, stats: &FrameStats) {
        if let Some(pacing) = &mut self.pacing {
            pacing.learn(stats);
        }
        if let Some(RayBacklog { points: points @ 1.., oldest }) = stats.waiting {
            self.late.frames += 1;
            self.late.points = self.late.points.max(points);
            self.late.oldest = self.late.oldest.max(oldest);
        }
    }

    /// Sends what is under way; gives back where frames went, and what had to wait.
    pub(super) fn finish(self) -> Outcome<(Outlet, Late)> {
        let outlet = match self.stages {
            Stages::Whole(_, outlet) => outlet,
            Stages::Halves { jobs, writer, .. } => {
                drop(jobs);
                writer.join().map_err(|_| Failure::new(Exit::System, "the writing thread failed"))??
            }
        };
        Ok((outlet, self.late))
    }
}

/// Writes and sends frames until no more come.
fn write(mut back: Back, mut outlet: Outlet, queue: &Receiver<Job>) -> Outcome<Outlet> {
    let clock = Stopwatch::start();
    for Job { edits, traced, captured } in queue {
        edits.iter().try_for_each(|edit| outlet.announce(edit))?;
        let (output, produced) = back.write(traced, &clock)?;
        outlet.send((output, &produced), back.state(), captured, |info| back.keyframe(info))?;
    }
    Ok(outlet)
}
