//! A cache of the hits of a point's rays in its own body.
//!
//! A point's rays turn with its body. As long as the body keeps its shape, their hits in it are bit-identical. So
//! near a moving instance only the rest of the scene must be traced again.

use super::ray_packet::{RayPacket, RayReach};

/// Distances of the hits of one point's rays in its own body.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SelfHits {
    /// Bit per ray, in groups of eight: whether it hit.
    hits: Box<[u8]>,
    /// Distances of the hits in the order of the rays; empty for binary occlusion, where distances are irrelevant.
    distances: Box<[f32]>,
}

/// Records [`SelfHits`] from successive packets.
#[derive(Debug, Default)]
pub(super) struct SelfHitRecorder {
    hits: Vec<u8>,
    distances: Vec<f32>,
}

/// Restores [`SelfHits`] to successive packets.
#[derive(Debug)]
pub(super) struct SelfHitReader<'a> {
    hits: &'a [u8],
    distances: &'a [f32],
}

impl SelfHits {
    /// Returns the bytes of memory held, including the struct itself.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + self.hits.len() + size_of_val(&*self.distances)
    }

    pub(super) fn reader(&self) -> SelfHitReader<'_> {
        SelfHitReader { hits: &self.hits, distances: &self.distances }
    }
}

impl SelfHitRecorder {
    /// Starts a new point.
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

    /// Returns the hits recorded since the last [`SelfHitRecorder::clear`].
    pub(super) fn self_hits(&self) -> SelfHits {
        SelfHits { hits: self.hits.as_slice().into(), distances: self.distances.as_slice().into() }
    }
}

impl SelfHitReader<'_> {
    /// Restores the recorded hits to a packet right after its start.
    pub(super) fn restore<const ANY: bool>(&mut self, packet: &mut RayPacket) {
        let groups = packet.groups();
        let (hits, rest) = self.hits.split_at(groups.min(self.hits.len()));
        self.hits = rest;
        for (group, &hits) in hits.iter().enumerate().filter(|(_, hits)| **hits != 0) {
            let rays = (0..8).filter(|ray| hits >> ray & 1 == 1);
            packet.set(group, rays.map(|ray| (ray, self.next::<ANY>())));
        }
    }

    /// Returns how far the next ray with a hit reaches.
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
