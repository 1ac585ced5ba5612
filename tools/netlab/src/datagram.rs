//! A pipe for datagrams, which may be lost, duplicated or reordered.

use psao_proto::Micros;

use crate::link::{Link, Transit};
use crate::queue::Queue;

/// Datagrams in transit in one direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct DatagramPipe {
    in_transit: Queue<Vec<u8>>,
}

impl DatagramPipe {
    pub(crate) fn send(&mut self, link: &mut Link, datagram: Vec<u8>, now: Micros) {
        if let Transit::Arrives { at, duplicate } = link.send(&datagram, now) {
            if let Some(at) = duplicate {
                self.in_transit.push(at, datagram.clone());
            }
            self.in_transit.push(at, datagram);
        }
    }

    /// Returns the next datagram that has arrived by `now`.
    pub(crate) fn receive(&mut self, now: Micros) -> Option<Vec<u8>> {
        self.in_transit.pop(now).map(|(_, datagram)| datagram)
    }

    /// Returns the arrival time of the next datagram.
    pub(crate) fn next_event_time(&self) -> Option<Micros> {
        self.in_transit.next_event_time()
    }
}
