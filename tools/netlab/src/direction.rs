//! One direction between two ends: the bytes of a connection and datagrams, over the same link.

use psao_proto::Micros;

use crate::datagram::DatagramPipe;
use crate::link::{Link, Traffic};
use crate::stream::StreamPipe;

/// One direction.
#[derive(Clone, Debug)]
pub(crate) struct Direction {
    link: Link,
    stream: StreamPipe,
    datagrams: DatagramPipe,
}

impl Direction {
    /// Over a link; acknowledgements of the bytes take `back` the other way.
    pub(crate) fn new(link: Link, back: Micros) -> Self {
        Self { link, stream: StreamPipe::new(back), datagrams: DatagramPipe::default() }
    }

    /// Takes as many bytes as fit the send buffer; they go with the next [`receive`](Self::receive).
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        self.stream.write(bytes)
    }

    /// Lets everything happen up to now; the bytes that came, in order.
    pub(crate) fn receive(&mut self, now: Micros) -> Vec<u8> {
        self.stream.receive(&mut self.link, now)
    }

    pub(crate) fn send_datagram(&mut self, datagram: Vec<u8>, now: Micros) {
        self.datagrams.send(&mut self.link, datagram, now);
    }

    /// Returns the next datagram that has come.
    pub(crate) fn receive_datagram(&mut self, now: Micros) -> Option<Vec<u8>> {
        self.datagrams.receive(now)
    }

    /// When something happens next.
    pub(crate) fn next(&self) -> Option<Micros> {
        [self.stream.next(&self.link), self.datagrams.next()].into_iter().flatten().min()
    }

    pub(crate) const fn counts(&self) -> Traffic {
        self.link.counts()
    }

    /// Segments sent again.
    pub(crate) const fn resent(&self) -> u64 {
        self.stream.resent()
    }

    /// Returns a digest of every packet, with its time.
    pub(crate) fn digest(&self) -> blake3::Hash {
        self.link.digest()
    }
}
