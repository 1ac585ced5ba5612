//! Where the frames of a live server go: to its clients, and into a recording.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::envelope::{FrameInfo, FrameKind};
use psao_proto::Micros;
use psao_proto::message::{Close, CloseCode, Edit};
use psao_proto::net::Hub;
use psao_server_sim::server::StepOutput;

use crate::error::{Exit, Failure, Outcome};
use crate::producer::Produced;
use crate::recorder::{Live, Recorder};

/// Clients, and the recording if there is one.
pub(super) struct Outlet {
    hub: Hub,
    recorder: Option<Recorder<Live>>,
    /// Whether stage times go with every frame.
    timings: bool,
}

impl Outlet {
    pub(super) fn new(hub: Hub, recorder: Option<Recorder<Live>>, timings: bool) -> Self {
        Self { hub, recorder, timings }
    }

    /// Says that an edit is part of all frames from the next one on.
    pub(super) fn announce(&mut self, edit: &Edit) -> Outcome {
        self.hub.edit(edit);
        self.recorder.as_mut().map_or(Ok(()), |tape| tape.message(tape.now(), edit))
    }

    /// Sends a frame. `keyframe` makes one of the state after it.
    pub(super) fn send(
        &mut self,
        (output, produced): (StepOutput, &Produced),
        state: StateRef<'_>,
        captured: Micros,
        keyframe: impl FnOnce(&FrameInfo) -> Outcome<Vec<u8>>,
    ) -> Outcome {
        let (info, body) = (output.info, Arc::<[u8]>::from(output.body));
        self.hub
            .broadcast(&info, Arc::clone(&body), state, captured)
            .map_err(|error| Failure::new(Exit::System, error))?;
        let report = self.timings.then(|| produced.report(info.frame, true));
        if let Some(budget) = &produced.budget {
            self.hub.budget(budget);
        }
        if let Some(report) = &report {
            self.hub.report(report);
        }
        let Some(tape) = &mut self.recorder else { return Ok(()) };
        // As it was sent, or as a keyframe where one ends a gap.
        if tape.wants_keyframe() {
            tape.body(tape.now(), true, &keyframe(&info)?)?;
        } else {
            tape.body(tape.now(), info.kind == FrameKind::Key, &body)?;
        }
        produced.budget.map_or(Ok(()), |budget| tape.message(tape.now(), &budget))?;
        report.map_or(Ok(()), |report| tape.message(tape.now(), &report))
    }

    /// Ends the recording; its length, if there is one.
    pub(super) fn finish(self, goodbye: &str) -> Outcome<Option<u64>> {
        let Some(mut tape) = self.recorder else { return Ok(None) };
        tape.message(tape.now(), &Close::new(CloseCode::STOPPED, goodbye))?;
        tape.finish().map(Some)
    }
}
