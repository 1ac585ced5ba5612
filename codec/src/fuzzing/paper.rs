//! Fuzz bodies of profile `paper`.

use std::sync::{Arc, OnceLock};

use super::{HASH_BYTES, LIMITS, damage, make_checksum_right, meta};
use crate::block::BlockCoder;
use crate::envelope::{EncodedFrame, FrameError, FrameKind, FrameMeta};
use crate::paper::{
    self, Bucket, Grid, InstanceLayout, Layout, Placement, PointFormat, PointSample, Pose, State, apply,
    keyframe,
};
use crate::reference::{self, PaperReferenceEncoder};

/// Number of points of every instance of the small layout.
const POINTS: u32 = 24;
/// Applies frame bodies made of `data` to a small state.
///
/// The first byte chooses the packing (its two highest bits) and the meaning of the other bytes (its low three bits).
/// 0 is a body as it is, 1 a body whose checksum is corrected. Other values are changes to a valid body (exclusive or
/// from an offset on), whose checksum is then corrected. A body that fails only for its state hash gets the right one
/// and must pass.
pub fn decode(data: &[u8]) {
    let Some((mode, rest)) = data.split_first() else { return };
    let Some(samples) = samples(format_of(*mode)) else { return };
    let (state, mut body) = match mode & 7 {
        0 | 1 => (&samples.after_key, rest.to_vec()),
        2 | 3 => (&samples.after_key, samples.delta.clone()),
        4 => (&samples.after_key, samples.plain_delta.clone()),
        5 => (&samples.empty, samples.plain_key.clone()),
        _ => (&samples.empty, samples.key.clone()),
    };
    if mode & 7 > 1 {
        damage(&mut body, rest);
    }
    if mode & 7 > 0 {
        make_checksum_right(&mut body);
    }
    if let Some(FrameError::Hash { computed, .. }) = check_apply(state, &body) {
        body[HASH_BYTES].copy_from_slice(&computed.0.to_le_bytes());
        make_checksum_right(&mut body);
        let refused = check_apply(state, &body);
        assert_eq!(refused, None, "only the hash was wrong");
    }
}

/// Drives the encoder and its reference with operations read from `data`, and applies every frame to a client. After
/// each frame it checks that bytes, states, hashes, counts and look-ups agree. The two highest bits of the first byte
/// also choose the packing.
pub fn round_trip(data: &[u8]) {
    let Some(mut harness) = Harness::new(format_of(data.first().copied().unwrap_or(0))) else { return };
    let mut bytes = data.iter().copied();
    while let Some(operation) = bytes.next() {
        let mut byte = || bytes.next().unwrap_or(0);
        match operation & 15 {
            0..=8 => {
                let point = u32::from(byte()) % (3 * POINTS);
                let sample = sample_at(point / POINTS, [byte(), byte(), byte()], byte(), byte());
                harness.put(point, &sample);
            }
            9 | 10 => harness.remove(u32::from(byte()) % (3 * POINTS)),
            11 => harness.set_pose(u32::from(byte()) % 3, pose_of(byte())),
            12 => harness.retry(),
            kind => {
                let coder = match byte() & 3 {
                    0 => BlockCoder::Stored,
                    1 => BlockCoder::Lz4,
                    _ => BlockCoder::Zstd { level: 1 },
                };
                harness.finish(if kind == 15 { FrameKind::Key } else { FrameKind::Delta }, coder);
            }
        }
    }
    harness.finish(FrameKind::Delta, BlockCoder::Stored);
}

/// Returns the packing of the two highest bits of a byte: 1 is 24 bits, 2 is 16, the others are 32.
fn format_of(byte: u8) -> PointFormat {
    match byte >> 6 {
        1 => PointFormat::Bits24,
        2 => PointFormat::Bits16,
        _ => PointFormat::Bits32,
    }
}

/// Returns the layout of both fuzz bodies. Instance 0 is a roomy grid. Instance 1 has a single bucket, which
/// overflows. Instance 2 is so large that Eq. 1 wraps. There are fewer cells than the points could fill.
fn small_layout(format: PointFormat) -> Option<Arc<Layout>> {
    let instance = |dims, first_bucket, bucket_count| {
        let grid = Grid::new([-1.0, 0.0, 1.0], 0.5, dims).ok()?;
        Some(InstanceLayout { grid, first_bucket, bucket_count, kernel_radius: 0.25 })
    };
    let instances =
        vec![instance([4, 4, 4], 0, 8)?, instance([8, 8, 1], 8, 1)?, instance([260, 260, 2050], 9, 2)?];
    Layout::new(format, instances, 14, &LIMITS).ok().map(Arc::new)
}

/// Returns a point of an instance from a few bytes. Coordinates reach one cell beyond the grid.
fn sample_at(instance: u32, at: [u8; 3], normal: u8, ao: u8) -> PointSample {
    let [x, y, z] = at.map(|byte| f32::from(byte) / 255.0);
    let local = match instance {
        0 => [x * 2.5 - 1.2, y * 2.2, z * 2.2 + 0.9],
        1 => [x * 4.0 - 1.0, y * 4.0, 1.2],
        // Cells (4, 0, 0) and (0, 245, 2049) share a raw id; (4, 1, 0) and (5, 0, 0) do not.
        _ => match at[0] & 3 {
            0 => [1.0 + y * 0.5, z * 0.5, 1.0 + y * 0.5],
            1 => [-1.0 + y * 0.5, 122.5 + z * 0.5, 1025.5 + y * 0.25],
            2 => [1.0 + y * 0.5, 0.5 + z * 0.5, 1.0],
            _ => [1.5 + y * 0.5, z * 0.5, 1.0],
        },
    };
    PointSample { local, normal: crate::quant::oct::decode(normal), ao }
}

fn pose_of(byte: u8) -> Pose {
    let turned = if byte & 1 == 0 { [0.0, 0.0, 0.0, 1.0] } else { [0.6, 0.0, 0.8, 0.0] };
    Pose { translation: [f32::from(byte >> 4), -0.0, 0.25], rotation: turned }
}

/// The encoder, its reference, and a client that has applied every frame.
struct Harness {
    fast: paper::Encoder,
    slow: PaperReferenceEncoder,
    client: State,
    frames: u32,
}

impl Harness {
    fn new(format: PointFormat) -> Option<Harness> {
        let layout = small_layout(format)?;
        let fast = paper::Encoder::new(Arc::clone(&layout), &[POINTS; 3]).ok()?;
        let slow = PaperReferenceEncoder::new(Arc::clone(&layout), &[POINTS; 3]);
        Some(Harness { fast, slow, client: State::new(layout), frames: 0 })
    }

    fn put(&mut self, point: u32, sample: &PointSample) {
        let placed = self.fast.put(point, sample).map(|placed| placed.placement);
        assert_eq!(placed, Ok(self.slow.put(point as usize, sample)));
    }

    fn remove(&mut self, point: u32) {
        assert_eq!(self.fast.remove(point), Ok(()));
        self.slow.remove(point as usize);
    }

    fn set_pose(&mut self, instance: u32, pose: Pose) {
        assert_eq!(self.fast.set_pose(instance, pose), Ok(()));
        self.slow.set_pose(instance as usize, pose);
    }

    fn retry(&mut self) {
        self.fast.retry_unplaced();
        self.slow.retry_unplaced();
    }

    fn finish(&mut self, kind: FrameKind, coder: BlockCoder) {
        let kind = if self.frames == 0 { FrameKind::Key } else { kind };
        let meta = meta(kind, self.frames);
        self.frames += 1;
        let (fast, slow) = (self.fast.finish(meta, coder), self.slow.finish(&meta, coder));
        assert_eq!(fast, slow);
        let Ok(EncodedFrame { body, info }) = fast else { return };
        let applied = apply(&mut self.client, &body, &LIMITS);
        assert_eq!(applied, Ok(info));
        assert_eq!(&self.client, self.fast.state());
        assert_eq!(&self.client, self.slow.state());
        assert_eq!(self.client.hash(), self.client.full_hash());
        assert_eq!(self.fast.counts(), self.slow.counts());
        self.check_lookups();
        self.check_late_join(meta, coder);
    }

    /// Checks that look-ups find every stored point and nothing else.
    fn check_lookups(&self) {
        let format = self.client.layout().format();
        let mut found = 0;
        for (instance, cell, word) in self.slow.stored() {
            let held = self.client.lookup(instance, cell);
            assert!(held.is_some_and(|cell| cell.packed(format).any(|point| point == word)), "not found");
            assert!(word.leading_zeros() >= u32::BITS - format.bits(), "{word:x} is wider than its packing");
            found += 1;
        }
        let named = self.client.buckets().iter().flat_map(Bucket::entries);
        assert_eq!(named.map(|entry| u32::from(entry.points())).sum::<u32>(), found);
        let placed = (0..3 * POINTS).filter(|point| self.fast.placement(*point) == Some(Placement::Stored));
        assert_eq!(placed.count() as u32, found);
    }

    /// Checks that a client that joins now holds the same.
    fn check_late_join(&self, meta: FrameMeta, coder: BlockCoder) {
        let mut late = State::new(Arc::clone(self.client.layout()));
        let joined = keyframe(&self.client, meta, coder).map(|body| apply(&mut late, &body, &LIMITS).is_ok());
        assert_eq!(joined, Ok(true));
        assert_eq!(late, self.client);
    }
}

/// Valid frames to damage, and the states that they fit.
struct Samples {
    empty: State,
    after_key: State,
    key: Vec<u8>,
    delta: Vec<u8>,
    plain_key: Vec<u8>,
    plain_delta: Vec<u8>,
}

fn samples(format: PointFormat) -> Option<&'static Samples> {
    static SAMPLES: [OnceLock<Option<Samples>>; 3] = [const { OnceLock::new() }; 3];
    SAMPLES[4 - format.bytes()].get_or_init(|| make_samples(format)).as_ref()
}

fn make_samples(format: PointFormat) -> Option<Samples> {
    let layout = small_layout(format)?;
    let mut encoder = paper::Encoder::new(Arc::clone(&layout), &[POINTS; 3]).ok()?;
    let mut plain = paper::Encoder::new(Arc::clone(&layout), &[POINTS; 3]).ok()?;
    let mut frames = Vec::new();
    for (kind, frame) in [(FrameKind::Key, 0), (FrameKind::Delta, 1)] {
        for encoder in [&mut encoder, &mut plain] {
            for point in 0..POINTS {
                let at = point as u8;
                let sample = sample_at(0, [at * 9, 40, at * 3], at, at + frame * 40);
                encoder.put(point, &sample).ok()?;
            }
            encoder.set_pose(1, pose_of(0x31 + frame * 0x10)).ok()?;
        }
        frames.push(encoder.finish(meta(kind, u32::from(frame)), BlockCoder::default()).ok()?.body);
        frames.push(plain.finish(meta(kind, u32::from(frame)), BlockCoder::Stored).ok()?.body);
    }
    let [key, plain_key, delta, plain_delta] = frames.try_into().ok()?;
    let empty = State::new(layout);
    let mut after_key = empty.clone();
    apply(&mut after_key, &key, &LIMITS).ok()?;
    Some(Samples { empty, after_key, key, delta, plain_key, plain_delta })
}

/// Applies a body by decoder and reference. They must agree, and a refused frame must leave the state unchanged.
fn check_apply(state: &State, body: &[u8]) -> Option<FrameError> {
    let mut after = state.clone();
    let applied = apply(&mut after, body, &LIMITS);
    let expected = reference::apply(state, body, &LIMITS);
    match applied {
        Ok(_) => {
            assert_eq!(Ok(&after), expected.as_ref());
            assert_eq!(after.hash(), after.full_hash());
            None
        }
        Err(error) => {
            assert!(expected.is_err(), "refused: {error}, the reference does not");
            assert!(after == *state, "refused: {error}, but the state changed");
            Some(error)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn encoder_and_reference_agree(data in prop::collection::vec(any::<u8>(), 0..1500)) {
            round_trip(&data);
        }

        #[test]
        fn damaged_frames_do_no_harm(data in prop::collection::vec(any::<u8>(), 0..300)) {
            decode(&data);
        }

        #[test]
        fn frames_with_one_byte_changed_do_no_harm(
            mode in 2_u8..8, packing in 0_u8..3, at in any::<u16>(), change in any::<u8>(),
        ) {
            let [low, high] = at.to_le_bytes();
            decode(&[mode | packing << 6, low, high, change]);
        }
    }

    #[test]
    fn the_small_layout_meets_every_kind_of_overflow() {
        let mut harness = Harness::new(PointFormat::Bits16).unwrap();
        let mut seen = std::collections::BTreeSet::new();
        for round in 0..4_u8 {
            // Instance 1 first: its only bucket must fill while there are cells left.
            for point in (POINTS..3 * POINTS).chain(0..POINTS) {
                let spread = (point as u8).wrapping_mul(37).wrapping_add(round);
                let at = if round < 2 { [spread, spread.wrapping_mul(5), 7] } else { [0; 3] };
                harness.put(point, &sample_at(point / POINTS, at, 0, 0));
                seen.insert(format!("{:?}", harness.fast.placement(point).unwrap()));
            }
            harness.finish(FrameKind::Delta, BlockCoder::Lz4);
        }
        for point in 0..2 * POINTS {
            harness.remove(point);
        }
        for (point, kind) in (2 * POINTS..).zip([0, 1, 2, 3]) {
            harness.put(point, &sample_at(2, [kind, 100, 100], 0, 0));
            seen.insert(format!("{:?}", harness.fast.placement(point).unwrap()));
        }
        harness.retry();
        harness.finish(FrameKind::Delta, BlockCoder::Lz4);
        let all = ["BucketFull", "CellFull", "IdCollision", "NoCell", "Stored"];
        assert_eq!(seen.iter().map(String::as_str).collect::<Vec<_>>(), all);
    }
}
