//! Hits of a point's rays in its own body, kept from frame to frame.
//!
//! A point's rays turn with its body. As long as the body keeps its shape, their hits in it are bit-identical. So near a
//! moving instance only the rest of the scene has to be traced again.

use super::ray_packet::{RayPacket, RayReach};

/// Distances of the hits of one point's rays in its own body.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SelfHits {
    /// Bit per ray, groups of eight: whether it hit.
    hits: Box<[u8]>,
    /// Distances of those that hit, in the order of the rays; empty where a hit at any distance is all the same.
    distances: Box<[f32]>,
}

/// Collects [`SelfHits`] from one packet after the other.
#[derive(Debug, Default)]
pub(super) struct SelfHitRecorder {
    hits: Vec<u8>,
    distances: Vec<f32>,
}

/// Restores [`SelfHits`] to one packet after the other.
#[derive(Debug)]
pub(super) struct SelfHitReader<'a> {
    hits: &'a [u8],
    distances: &'a [f32],
}

impl SelfHits {
    /// Returns the bytes of memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + self.hits.len() + size_of_val(&*self.distances)
    }

    pub(super) fn reader(&self) -> SelfHitReader<'_> {
        SelfHitReader { hits: &self.hits, distances: &self.distances }
    }
}

impl SelfHitRecorder {
    /// Starts with a new point.
    pub(super) fn clear(&mut self) {
        self.hits.clear();
        self.distances.clear();
    }

    /// Records the hits of a packet's rays.
    pub(super) fn record(&mut self, packet: &RayPacket) {
        for rays in packet.reaches() {
            let mut hits = 0;
            for (ray, reach) in rays.enumerate() {
                match reach {
                    RayReach::Unbounded => continue,
                    RayReach::Hit => {}
                    RayReach::At(distance) => self.distances.push(distance),
                }
                hits |= 1 << ray;
            }
            self.hits.push(hits);
        }
    }

    /// Returns what was recorded since the last [`SelfHitRecorder::clear`].
    pub(super) fn self_hits(&self) -> SelfHits {
        SelfHits { hits: self.hits.as_slice().into(), distances: self.distances.as_slice().into() }
    }
}

impl SelfHitReader<'_> {
    /// Restores the recorded hits to a packet that was just begun.
    pub(super) fn restore<const ANY: bool>(&mut self, packet: &mut RayPacket) {
        let groups = packet.groups();
        let (hits, rest) = self.hits.split_at(groups.min(self.hits.len()));
        self.hits = rest;
        for (group, &hits) in hits.iter().enumerate().filter(|(_, hits)| **hits != 0) {
            let rays = (0..8).filter(|ray| hits >> ray & 1 == 1);
            packet.set(group, rays.map(|ray| (ray, self.next::<ANY>())));
        }
    }

    /// How far the next ray that hit something got.
    fn next<const ANY: bool>(&mut self) -> RayReach {
        match self.distances.split_first() {
            Some((&distance, rest)) if !ANY => {
                self.distances = rest;
                RayReach::At(distance)
            }
            _ => RayReach::Hit,
        }
    }
}
