//! One direction between two ends. The bytes of a connection and datagrams share its link.

use psao_proto::Micros;

use crate::datagram::DatagramPipe;
use crate::link::{Link, Traffic};
use crate::stream::StreamPipe;

/// One direction between two ends.
#[derive(Clone, Debug)]
pub(crate) struct Direction {
    link: Link,
    stream: StreamPipe,
    datagrams: DatagramPipe,
}

impl Direction {
    /// Creates a direction over `link`. Acknowledgements of the bytes take `ack_delay` to return.
    pub(crate) fn new(link: Link, ack_delay: Micros) -> Self {
        Self { link, stream: StreamPipe::new(ack_delay), datagrams: DatagramPipe::default() }
    }

    /// Takes the bytes that fit the send buffer and returns their number. The next [`receive`](Self::receive) sends
    /// them.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        self.stream.write(bytes)
    }

    /// Advances to `now` and returns the bytes that have arrived, in order.
    pub(crate) fn receive(&mut self, now: Micros) -> Vec<u8> {
        self.stream.receive(&mut self.link, now)
    }

    pub(crate) fn send_datagram(&mut self, datagram: Vec<u8>, now: Micros) {
        self.datagrams.send(&mut self.link, datagram, now);
    }

    /// Returns the next datagram that has arrived by `now`.
    pub(crate) fn receive_datagram(&mut self, now: Micros) -> Option<Vec<u8>> {
        self.datagrams.receive(now)
    }

    /// Returns the time of the next event.
    pub(crate) fn next_event_time(&self) -> Option<Micros> {
        [self.stream.next_event_time(&self.link), self.datagrams.next_event_time()]
            .into_iter()
            .flatten()
            .min()
    }

    pub(crate) const fn counts(&self) -> Traffic {
        self.link.counts()
    }

    /// Returns the number of segments that were sent again.
    pub(crate) const fn resent(&self) -> u64 {
        self.stream.resent()
    }

    /// Returns a digest of every packet and its time.
    pub(crate) fn digest(&self) -> blake3::Hash {
        self.link.digest()
    }
}
