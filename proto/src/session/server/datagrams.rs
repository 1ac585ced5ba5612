//! Updates sent as datagrams, and acknowledgements received as datagrams.

use psao_codec::envelope::FrameKind;

use super::super::datagram::{read_ack, split};
use super::super::flight::Route;
use super::super::{Demand, SendError, ServerEvent, SharedBody};
use super::ServerSession;
use crate::{FrameIndex, Micros};

impl ServerSession {
    /// Processes a datagram from the client, which must be an acknowledgement. Any other datagram is counted and
    /// dropped.
    pub fn handle_datagram(&mut self, bytes: &[u8], now: Micros) -> Option<ServerEvent> {
        self.timers.set_now(now);
        if !self.is_joined() {
            return None;
        }
        // Excess datagrams are dropped, because anyone on the network may send them.
        let allowed = self.frames_left.take(1, now) && self.bytes_left.take(bytes.len(), now);
        let Some(ack) = read_ack(bytes).filter(|_| allowed) else {
            self.stats.bad_datagrams += 1;
            return None;
        };
        self.timers.note_received();
        Some(self.acked(ack))
    }

    /// Sends an update as datagrams. It must apply to the frame `base` and any later one. Waiting datagrams of older
    /// frames are dropped. Returns whether the update was sent.
    ///
    /// When acknowledgements are overdue, the update also goes over the connection. An update of too many datagrams is
    /// dropped, and the client's demand changes to updates over the connection for a while. One over the limit for
    /// datagram bodies changes the demand to a keyframe.
    ///
    /// # Errors
    /// As [`send_update`](Self::send_update).
    pub fn send_datagrams(&mut self, body: &SharedBody, base: FrameIndex) -> Result<bool, SendError> {
        if body.kind != FrameKind::Delta {
            return Err(SendError::Kind);
        }
        let wanted = self.demand() == (Demand::Datagrams { base });
        let (Some(bytes), true, true) = (self.datagram_bytes, wanted, self.check_body(body)?) else {
            self.stats.dropped += 1;
            return Ok(false);
        };
        let small = body.bytes.len() <= self.limits.max_datagram_body as usize;
        let Some(datagrams) = split(body.frame, &body.bytes, bytes).filter(|_| small) else {
            self.position.holds = None;
            self.stats.dropped += 1;
            return Ok(false);
        };
        let now = self.timers.now();
        let route = self.flight.choose(body.frame, datagrams.len(), self.outbox.is_empty(), now);
        if route == Route::Connection {
            return Ok(false);
        }
        self.lagging = false;
        let bytes = datagrams.iter().map(|datagram| datagram.len() as u64).sum();
        self.stats.wire_bytes += bytes;
        self.stats.datagram_frames += 1;
        self.datagrams = datagrams;
        if route == Route::Both {
            let before = self.position;
            let head = self.position.numbering.update_head(&body.bytes)?;
            self.push_state(&head, body, before);
            self.stats.updates += 1;
        } else {
            self.flight.expect((body.frame, body.hash), now, bytes, true);
        }
        self.position.context_lost = true;
        Ok(true)
    }

    /// Returns the next datagram to send.
    #[must_use]
    pub fn take_datagram(&mut self) -> Option<Vec<u8>> {
        self.datagrams.pop_front()
    }

    /// Returns whether the client asked for updates as datagrams.
    #[must_use]
    pub const fn takes_datagrams(&self) -> bool {
        self.datagram_bytes.is_some()
    }
}
