//! A pipe for datagrams: they may be lost, come twice, or overtake each other.

use psao_proto::Micros;

use crate::link::{Link, Passage};
use crate::queue::Queue;

/// Datagrams on their way in one direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct DatagramPipe {
    coming: Queue<Vec<u8>>,
}

impl DatagramPipe {
    pub(crate) fn send(&mut self, link: &mut Link, datagram: Vec<u8>, now: Micros) {
        if let Passage::Comes { at, again } = link.send(&datagram, now) {
            if let Some(again) = again {
                self.coming.push(again, datagram.clone());
            }
            self.coming.push(at, datagram);
        }
    }

    /// Returns the next datagram that has come.
    pub(crate) fn receive(&mut self, now: Micros) -> Option<Vec<u8>> {
        self.coming.pop(now).map(|(_, datagram)| datagram)
    }

    /// When the next one comes.
    pub(crate) fn next(&self) -> Option<Micros> {
        self.coming.next()
    }
}
