//! Updates received as datagrams, and their acknowledgements.

use psao_codec::envelope::{FrameBody, FrameError};

use super::super::datagram::{Reassembly, write_ack};
use super::{AppliedFrame, ClientEvent, ClientSession, Phase};
use crate::Micros;
use crate::follow::FollowError;
use crate::message::Ack;

impl ClientSession {
    /// Processes a datagram from the server, which holds a piece of a frame body. A useless datagram is counted and
    /// dropped. A complete body is applied like an update, to its base state or any later one.
    pub fn handle_datagram(&mut self, bytes: &[u8], now: Micros) -> Vec<ClientEvent> {
        self.timers.set_now(now);
        let mut events = Vec::new();
        let Phase::Running(follower) = &mut self.phase else { return events };
        (self.stats.datagrams, self.stats.wire_bytes) =
            (self.stats.datagrams + 1, self.stats.wire_bytes + bytes.len() as u64);
        match self.reassembler.take(bytes, follower.state().frame(), &self.limits) {
            Reassembly::Bad => self.stats.bad_datagrams += 1,
            Reassembly::Waiting => self.timers.note_received(),
            Reassembly::Whole(frame, body) => {
                self.timers.note_received();
                let wire_bytes = body.len() as u64;
                let body = FrameBody::parse(body, &self.limits.codec);
                let patched = body.map_err(FollowError::from).and_then(|body| {
                    let place = follower.patch(&body, &self.limits)?;
                    Ok((body.into_info(), place))
                });
                match patched {
                    Ok((info, (group, sequence))) => {
                        let ack = Ack { frame: info.frame, hash: info.hash };
                        // The newest acknowledgement covers all earlier ones.
                        self.datagrams = vec![write_ack(&ack)];
                        self.stats.applied += 1;
                        let stamp = self.stamp.take().filter(|stamp| stamp.frame == info.frame);
                        let frame = AppliedFrame { info, group, sequence, wire_bytes, received: now, stamp };
                        events.push(ClientEvent::Applied(frame));
                    }
                    Err(FollowError::Body(FrameError::Hash { stored, computed, .. })) => {
                        events.push(self.mismatch(frame, stored, computed));
                    }
                    Err(_) => self.stats.late_datagram_frames += 1,
                }
            }
        }
        events
    }

    /// Returns the next datagram to send to the server.
    #[must_use]
    pub fn take_datagram(&mut self) -> Option<Vec<u8>> {
        self.datagrams.pop()
    }
}
