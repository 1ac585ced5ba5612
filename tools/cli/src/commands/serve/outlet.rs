//! Where the frames of a live server go: to its clients, and into a recording.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::envelope::{FrameInfo, FrameKind};
use psao_proto::Micros;
use psao_proto::message::{Close, CloseCode, Edit};
use psao_proto::net::Hub;
use psao_proto::recording::file::Recorder;
use psao_server::server::StepOutput;

use crate::error::{Exit, Failure, Outcome};
use crate::producer::Produced;

/// Clients, and the recording if there is one.
pub(super) struct Outlet {
    hub: Hub,
    recorder: Option<Recorder>,
    /// Whether stage times go with every frame.
    timings: bool,
}

impl Outlet {
    pub(super) fn new(hub: Hub, recorder: Option<Recorder>, timings: bool) -> Self {
        Self { hub, recorder, timings }
    }

    /// Says that an edit is part of all frames from the next one on.
    pub(super) fn announce(&mut self, edit: &Edit) -> Outcome {
        self.hub.edit(edit);
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        Ok(recorder.message(recorder.now(), edit)?)
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
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        // As it was sent, or as a keyframe where one ends a gap.
        if recorder.wants_keyframe() {
            recorder.body(recorder.now(), FrameKind::Key, &keyframe(&info)?)?;
        } else {
            recorder.body(recorder.now(), info.kind, &body)?;
        }
        if let Some(budget) = &produced.budget {
            recorder.message(recorder.now(), budget)?;
        }
        if let Some(report) = &report {
            recorder.message(recorder.now(), report)?;
        }
        Ok(())
    }

    /// Ends the recording; its length, if there is one.
    pub(super) fn finish(self, goodbye: &str) -> Outcome<Option<u64>> {
        let Some(mut recorder) = self.recorder else { return Ok(None) };
        recorder.message(recorder.now(), &Close::new(CloseCode::STOPPED, goodbye))?;
        Ok(Some(recorder.finish()?.bytes))
    }
}
