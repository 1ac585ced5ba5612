//! Fuzz bodies of profile `surface`.

use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

use super::{HASH_BYTES, LIMITS, damage, make_checksum_right, meta};
use crate::StateHash;
use crate::block::{BlockCoder, CoderId};
use crate::envelope::{
    EncodedFrame, FrameError, FrameIndex, FrameInfo, FrameKind, SectionInfo, SectionTag, assemble,
};
use crate::reference::{SurfaceReferenceEncoder, apply_surface};
use crate::surface::{
    Budget, ChangeLog, Decoder, Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Layout,
    Levels, Member, NO_VALUE, RestPoint, SetLayout, State, frame_ids, keyframe, patch, preview,
};

const CODERS: [BlockCoder; 4] =
    [BlockCoder::Range, BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::Zstd { level: 1 }];

/// Applies frame bodies of profile `surface` made of `data` to a state of a small stream.
///
/// The low four bits of the first byte choose one of 16 valid frames: a keyframe, a delta with arrivals, a delta with
/// only changes and a keyframe for a late client, each with every coder. With the high bit they choose one of 16
/// patches: without and with coder context, for the state of the last frame and for an earlier one. Bits 4 and 5
/// choose the meaning of the other bytes. 0 and 1 are changes to that frame (exclusive or from an offset on). 2 is one
/// section for the state before it: tag, coder, u16 records, u16 raw bytes and the block. 3 is a body as it is. The
/// checksum is then corrected, except for 3. A body that fails only for its state hash gets the right one and must
/// pass.
pub fn surface_decode(data: &[u8]) {
    let Some((mode, rest)) = data.split_first() else { return };
    let Some(sample) = samples().and_then(|samples| samples.get(usize::from(mode & 15 | mode >> 7 << 4)))
    else {
        return;
    };
    let mut body = sample.body.clone();
    match mode >> 4 & 3 {
        0 | 1 => damage(&mut body, rest),
        2 => match one_section(sample.kind, rest) {
            Some(section) => body = section,
            None => return,
        },
        _ => body = rest.to_vec(),
    }
    if mode >> 4 & 3 < 3 {
        make_checksum_right(&mut body);
    }
    if let Some(FrameError::Hash { computed, .. }) = check_apply(&sample.before, &body) {
        body[HASH_BYTES].copy_from_slice(&computed.0.to_le_bytes());
        make_checksum_right(&mut body);
        let refused = check_apply(&sample.before, &body);
        assert_eq!(refused, None, "only the hash was wrong");
    }
    check_preview(&sample.before, &body, usize::from(*mode) * 7);
}

/// Drives encoder, decoder and their references with operations read from `data`, and a client that joins late. After
/// every frame it checks that all hold the same, and that no value is off by its threshold. With a byte budget, it may
/// be for some frames. The first byte is the threshold. The second tells whether
/// the stream carries the geometry (lowest bit), whether there is a budget (next bit), its size (the next three) and
/// how long points may wait (the others).
pub fn surface_round_trip(data: &[u8]) {
    let [threshold, source, operations @ ..] = data else { return };
    let (step, longest_age) = (source >> 2 & 7, u16::from(source >> 5));
    let budget = Budget { bytes: 28 + 12 * u32::from(step), longest_age };
    let budget = (source & 2 != 0).then_some(budget);
    let source = if source & 1 == 0 { GeometrySource::Sent } else { GeometrySource::Shared };
    let settings = EncoderSettings::new((*threshold).max(1), source).with_budget(budget);
    let Some(mut harness) = Harness::new(settings) else { return };
    let mut bytes = operations.iter().copied();
    while let Some(operation) = bytes.next() {
        let mut byte = || bytes.next().unwrap_or(0);
        let coder = CODERS[usize::from(operation >> 4 & 3)];
        match operation & 15 {
            0..=3 => harness.set_ao(u32::from(byte()) + u32::from(operation >> 4) * 32, byte()),
            4..=6 => {
                let (first, count, ao, step) = (u32::from(byte()), u32::from(byte()), byte(), byte());
                for at in 0..count {
                    harness.set_ao(first + at, ao.wrapping_add(step.wrapping_mul(at as u8)));
                }
            }
            7 => harness.join_late(coder, &[(u32::from(byte()), 0), (1, 1)]),
            8 => harness.fail(),
            9 => harness.catch_up(coder, byte(), operation & 0x80 != 0),
            10 => harness.set_ao_within(u32::from(byte()) + u32::from(operation >> 4) * 32, byte(), byte()),
            11 => harness.release(u32::from(byte()) + u32::from(operation >> 4) * 32, byte()),
            14 => harness.set_weight(
                u32::from(byte()),
                usize::from(byte()),
                u16::from_le_bytes([byte(), byte()]),
            ),
            15 => harness.finish(FrameKind::Key, coder),
            _ => harness.finish(FrameKind::Delta, coder),
        }
    }
    harness.finish(FrameKind::Delta, BlockCoder::Range);
}

/// Returns a floor of three levels, a ball, an empty set, and a few points at one node.
fn small_geometry() -> Vec<Arc<Geometry>> {
    let layout = |extent, normal_bits| SetLayout {
        origin: [-1.0, -1.0, -1.0],
        step: 1.0 / 32.0,
        extent,
        normal_bits,
        points: 0,
        charts: 8,
        levels: Levels::default(),
        kernel_radius: 0.3,
        digest: GeometryDigest::default(),
    };
    // Low bits of multiples of odd numbers: well distributed without a sine.
    let spread = |n: u32, by: u32| ((n * by) % 128) as f32 / 64.0 - 1.0;
    let floor = (0..260).map(|n| RestPoint {
        position: [spread(n, 29), 0.0, spread(n, 47)],
        normal: [0.0, 1.0, 0.0],
        chart: n % 2,
    });
    let ball = (0..70).map(|n| {
        let normal = [spread(n, 29), spread(n, 47), spread(n, 71)];
        let chart = (0..3).map(|axis| u32::from(normal[axis] > 0.0) << axis).sum();
        RestPoint { position: normal.map(|axis| axis * 0.5), normal, chart }
    });
    let node = (0..5).map(|n| RestPoint { position: [0.0; 3], normal: [1.0, spread(n, 31), 0.0], chart: n });
    let round = |layout, points: Vec<RestPoint>| Arc::new(Geometry::round(layout, &points).geometry);
    vec![
        round(layout([64; 3], 6), floor.collect()),
        round(layout([64; 3], 4), ball.collect()),
        round(layout([64; 3], 4), Vec::new()),
        round(layout([0, 5, 0], 2), node.collect()),
    ]
}

fn small_stream(settings: EncoderSettings) -> Option<(Encoder, State)> {
    static GEOMETRY: OnceLock<Vec<Arc<Geometry>>> = OnceLock::new();
    let geometry = GEOMETRY.get_or_init(small_geometry);
    let sets = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let members = [0, 1, 2, 1, 3].map(|set| Member { set }).to_vec();
    let layout = Arc::new(Layout::new(sets, members, &LIMITS).ok()?);
    let client = blank(&layout, settings.geometry)?;
    Some((Encoder::new(layout, geometry.clone(), settings).ok()?, client))
}

/// Returns a client that has received nothing.
fn blank(layout: &Arc<Layout>, source: GeometrySource) -> Option<State> {
    let mut client = State::new(Arc::clone(layout));
    if source == GeometrySource::Shared {
        for (set, geometry) in (0..).zip(small_geometry()) {
            client.share_geometry(set, geometry).ok()?;
        }
    }
    Some(client)
}

/// The encoder, the reference of its decisions, and clients that have applied every frame.
struct Harness {
    encoder: Encoder,
    reference: SurfaceReferenceEncoder,
    decoder: Decoder,
    client: State,
    late: Option<State>,
    log: ChangeLog,
    /// States of clients after the last frames, the oldest first.
    earlier: VecDeque<State>,
    frames: u32,
    /// By point: the number of frames in a row after which it was not within its threshold.
    beyond: Vec<u16>,
}

/// Number of frames after which a client counts as gone.
const REMEMBERED_FRAMES: usize = 6;

impl Harness {
    fn new(settings: EncoderSettings) -> Option<Harness> {
        let (encoder, client) = small_stream(settings)?;
        let layout = Arc::clone(client.layout());
        let points = layout.points() as usize;
        let reference = SurfaceReferenceEncoder::new(layout, &small_geometry(), settings);
        let log = ChangeLog::new(encoder.state());
        Some(Harness {
            encoder,
            reference,
            decoder: Decoder::new(),
            client,
            late: None,
            log,
            earlier: VecDeque::new(),
            frames: 0,
            beyond: vec![0; points],
        })
    }

    fn set_ao(&mut self, point: u32, ao: u8) {
        assert_eq!(self.encoder.set_ao(point, ao), self.reference.set_ao(point, ao));
    }

    fn set_ao_within(&mut self, point: u32, ao: u8, threshold: u8) {
        let found = self.encoder.set_ao_within(point, ao, threshold);
        assert_eq!(found, self.reference.set_ao_within(point, ao, threshold));
    }

    fn release(&mut self, first: u32, count: u8) {
        for point in first..first + u32::from(count) {
            self.encoder.release(point);
            self.reference.release(point);
        }
    }

    fn finish(&mut self, kind: FrameKind, coder: BlockCoder) {
        let kind = if self.frames == 0 { FrameKind::Key } else { kind };
        assert_eq!(self.encoder.pending_points(), self.reference.pending_points());
        self.reference.begin();
        let finished = self.encoder.finish(meta(kind, self.frames), coder);
        assert!(finished.is_ok(), "{finished:?}");
        let Ok(EncodedFrame { body, info }) = finished else { return };
        self.frames += 1;
        let (mut due, forced) =
            if kind == FrameKind::Delta { self.reference.ranked() } else { Default::default() };
        if kind == FrameKind::Delta {
            let sent = info.section(SectionTag::CHANGES).map_or(0, |section| section.records as usize);
            let allowed = self.reference.explain(sent, &self.values());
            assert!(allowed.is_some(), "no number of the {} points by rank explains the frame", due.len());
            due.truncate(allowed.unwrap_or_default());
        }
        let late = match kind {
            FrameKind::Key => 0,
            FrameKind::Delta => self.reference.late(&due),
        };
        self.reference.finish(kind, &due);
        self.check_budget(&info, body.len(), (due.len() <= forced, late));
        let expected = apply_surface(&self.client, &body, &LIMITS);
        assert_eq!(self.decoder.decode(&mut self.client, &body, &LIMITS), Ok(info));
        assert_eq!(Ok(&self.client), expected.as_ref());
        assert_eq!(&self.client, self.encoder.state());
        assert_eq!(self.client.hash(), self.client.full_hash());
        if let Some(late) = &mut self.late {
            assert!(self.decoder.decode(late, &body, &LIMITS).is_ok());
            assert_eq!(late, &self.client);
        }
        self.note_frame();
        self.check_values();
    }

    /// Returns the bytes of all points after the last frame of the encoder.
    fn values(&self) -> Vec<u8> {
        let instances = 0..self.client.layout().members().len() as u32;
        instances.flat_map(|instance| self.encoder.state().values(instance)).copied().collect()
    }

    fn note_frame(&mut self) {
        self.log.record(&self.client);
        if self.earlier.len() == REMEMBERED_FRAMES {
            self.earlier.pop_front();
        }
        self.earlier.push_back(self.client.clone());
    }

    fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        self.encoder.set_weight(instance % 6, block % 4, weight);
        self.reference.set_weight(instance % 6, block % 4, weight);
    }

    /// Checks that everything due is sent if it fits; otherwise as much as fits, at least what must not wait. `bare` tells
    /// whether no other point could change, and `forced` is the number of points sent that must not wait.
    fn check_budget(&self, info: &FrameInfo, bytes: usize, (bare, forced): (bool, u32)) {
        let records = |tag| {
            let sections = info.sections.iter().filter(move |section| section.tag == tag);
            sections.map(|section| section.records).sum::<u32>()
        };
        let (changed, arriving) = (records(SectionTag::CHANGES), records(SectionTag::VALUES));
        assert!(info.kind == FrameKind::Key || info.changed_points == arriving + changed);
        let waited: Vec<u64> =
            (0..self.client.layout().points()).map(|point| self.reference.waited(point)).collect();
        let late = waited.iter().filter(|waited| **waited > 0).count();
        let Some(Budget { bytes: most, longest_age }) = self.encoder.settings().budget else {
            assert_eq!((late, self.encoder.postponed()), (0, None));
            return;
        };
        let fits = bytes <= most as usize;
        assert!(
            fits || bare && changed == forced || info.kind == FrameKind::Key,
            "{changed}, {forced} forced: {bytes} B of {most}"
        );
        assert!(arriving > 0 || fits || changed > 0 || bytes == 29);
        let found = self.encoder.postponed().copied().unwrap_or_default();
        let oldest = waited.iter().max().copied().unwrap_or(0);
        assert_eq!((found.points, u64::from(found.oldest)), (late as u32, oldest));
        assert_eq!((found.forced, found.used), (forced, bytes as u32));
        assert!(found.oldest <= longest_age, "{found:?}");
    }

    /// Checks that clients hold what the reference tells, and that no value is off by its threshold after more frames in a
    /// row than a point may wait.
    fn check_values(&mut self) {
        let layout = self.client.layout();
        let longest = self.encoder.settings().budget.map_or(0, |budget| budget.longest_age);
        for instance in 0..layout.members().len() as u32 {
            let values = self.client.values(instance).iter();
            for ((value, at), point) in values.zip(0..).zip(layout.points_of(instance)) {
                let here = self.client.is_present(instance, at / crate::surface::BLOCK_POINTS);
                let id = point as u32;
                assert_eq!(here.then_some(*value), self.reference.held(id), "point {point}");
                let threshold = self.encoder.threshold(id);
                assert_eq!(threshold, self.reference.threshold(id), "point {point}");
                let (Some(threshold), Some(latest)) = (threshold, self.reference.latest(id)) else {
                    self.beyond[point] = 0;
                    continue;
                };
                let both = (latest == NO_VALUE) == (*value == NO_VALUE);
                let near = both && latest.abs_diff(*value) < threshold;
                self.beyond[point] = if near { 0 } else { self.beyond[point] + 1 };
                assert!(self.beyond[point] <= longest, "point {point}");
            }
        }
    }

    /// Lets another client join, which must be able to decode what follows.
    fn join_late(&mut self, coder: BlockCoder, first: &[(u32, u32)]) {
        let Some(frame) = self.client.frame() else { return };
        let source = self.encoder.settings().geometry;
        let Some(mut late) = blank(self.client.layout(), source) else { return };
        let body = keyframe(&self.client, meta(FrameKind::Key, frame.0), coder, first);
        let Ok(body) = body else { return assert!(body.is_ok(), "{body:?}") };
        let expected = apply_surface(&late, &body, &LIMITS);
        let joined = self.decoder.decode(&mut late, &body, &LIMITS);
        assert!(joined.is_ok(), "{joined:?}");
        assert_eq!(late, self.client);
        assert_eq!(Ok(&late), expected.as_ref());
        self.late = Some(late);
    }

    /// Patches clients that missed frames, from the `base`-th remembered one on; earlier ones must refuse the patch. A
    /// client with coder context goes on with the others.
    fn catch_up(&mut self, coder: BlockCoder, base: u8, context: bool) {
        let Some((last, behind)) = self.earlier.make_contiguous().split_last() else { return };
        let Some(frame) = last.frame() else { return };
        let base = usize::from(base) % (behind.len() + 1);
        let Some(from) = behind.get(base).and_then(State::frame) else { return };
        let body = patch(&self.client, &self.log, from, meta(FrameKind::Delta, frame.0), coder, context);
        let Ok(body) = body else { return assert!(body.is_ok(), "{body:?}") };
        let here = last.present_points();
        let Some(body) = body else {
            let same = |state: &State| state.present == last.present && state.received == last.received;
            return assert!(here == 0 || !behind[base..].iter().all(same), "a patch would do");
        };
        for (at, state) in behind.iter().enumerate() {
            let mut client = state.clone();
            let expected = apply_surface(state, &body, &LIMITS);
            let applied = self.decoder.decode(&mut client, &body, &LIMITS);
            assert_eq!(applied.is_ok(), at >= base, "{applied:?}");
            assert_eq!(expected.is_ok(), at >= base, "{expected:?}");
            if at < base {
                assert_eq!(&client, state);
                continue;
            }
            assert_eq!(Ok(&client), expected.as_ref());
            assert_eq!((client.hash(), client.full_hash()), (last.hash(), last.hash()));
            if context {
                assert_eq!(&client, last);
                self.late = Some(client);
            }
        }
    }

    /// Asks for a frame with a level that no coder has: nothing may change.
    fn fail(&mut self) {
        let before = self.encoder.state().clone();
        let kind = if self.frames.is_multiple_of(2) { FrameKind::Key } else { FrameKind::Delta };
        if self.encoder.finish(meta(kind, self.frames), BlockCoder::Zstd { level: 99 }).is_ok() {
            // It had nothing to compress. Clients get it, so that indices stay in order.
            self.client.clone_from(self.encoder.state());
            self.reference.begin();
            self.reference.finish(kind, &[]);
            self.late = None;
            self.frames += 1;
            self.note_frame();
            self.check_values();
        } else {
            self.reference.begin();
            assert_eq!(&before, self.encoder.state());
        }
    }
}

/// A valid frame, and the state that it fits.
struct Sample {
    before: State,
    kind: FrameKind,
    body: Vec<u8>,
}

fn samples() -> Option<&'static [Sample]> {
    static SAMPLES: OnceLock<Option<Vec<Sample>>> = OnceLock::new();
    SAMPLES.get_or_init(make_samples).as_deref()
}

fn make_samples() -> Option<Vec<Sample>> {
    let mut samples = Vec::new();
    for coder in CODERS {
        let (mut encoder, empty) = small_stream(EncoderSettings::new(4, GeometrySource::Sent))?;
        for (frame, latest) in [(0_u32, 200_u32), (1, 405), (2, 405)] {
            for point in 0..latest {
                let shadow = (point % 90).abs_diff(10 + frame * 8).min(30) as u8;
                encoder.set_ao(point, 150 + 3 * shadow)?;
            }
            let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
            let before = if frame == 0 { empty.clone() } else { encoder.state().clone() };
            let body = encoder.finish(meta(kind, frame), coder).ok()?.body;
            samples.push(Sample { before, kind, body });
        }
        let body = keyframe(encoder.state(), meta(FrameKind::Key, 2), coder, &[(1, 1)]).ok()?;
        samples.push(Sample { before: empty, kind: FrameKind::Key, body });
    }
    for coder in CODERS {
        make_patches(coder, &mut samples)?;
    }
    Some(samples)
}

/// Makes patches of a short stream without and with coder context, for the state before the last and for an earlier
/// one.
fn make_patches(coder: BlockCoder, samples: &mut Vec<Sample>) -> Option<()> {
    let (mut encoder, _) = small_stream(EncoderSettings::new(4, GeometrySource::Sent))?;
    let mut log = ChangeLog::new(encoder.state());
    let mut states = Vec::new();
    for frame in 0_u32..5 {
        for point in 0_u32..370 {
            let shadow = (point % 90).abs_diff(20 + frame * 8).min(30) as u8;
            encoder.set_ao(point, 150 + 3 * shadow)?;
        }
        let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
        encoder.finish(meta(kind, frame), BlockCoder::Range).ok()?;
        log.record(encoder.state());
        states.push(encoder.state().clone());
    }
    for (base, at, context) in [(3, 3, false), (1, 2, false), (3, 3, true), (0, 1, true)] {
        let state = encoder.state();
        let (base, meta) = (FrameIndex(base), meta(FrameKind::Delta, 4));
        let body = patch(state, &log, base, meta, coder, context).ok()??;
        samples.push(Sample { before: states.get(at)?.clone(), kind: FrameKind::Delta, body });
    }
    Some(())
}

/// Returns a body of one section.
fn one_section(kind: FrameKind, data: &[u8]) -> Option<Vec<u8>> {
    let (&[tag, coder, a, b, c, d], block) = data.split_first_chunk()?;
    let section = SectionInfo {
        tag: SectionTag(tag),
        coder: CoderId(coder),
        records: u16::from_le_bytes([a, b]).into(),
        raw_bytes: u16::from_le_bytes([c, d]).into(),
        wire_bytes: block.len() as u32,
    };
    let ids = frame_ids(kind);
    Some(assemble(&meta(kind, 9), ids, StateHash(1), vec![section], block).body)
}

/// Applies a body by decoder and reference. They must agree, and a refused frame must leave the state unchanged.
fn check_apply(state: &State, body: &[u8]) -> Option<FrameError> {
    let mut after = state.clone();
    let mut decoder = Decoder::new();
    let applied = decoder.decode(&mut after, body, &LIMITS);
    let expected = apply_surface(state, body, &LIMITS);
    match applied {
        Ok(_) => {
            assert_eq!(Ok(&after), expected.as_ref());
            assert_eq!(after.hash(), after.full_hash());
            // What a frame leaves in a decoder must not affect the next.
            let mut again = state.clone();
            assert!(decoder.decode(&mut again, body, &LIMITS).is_ok());
            assert_eq!(again, after);
            None
        }
        Err(error) => {
            assert!(expected.is_err(), "refused: {error}, the reference does not");
            assert!(after == *state, "refused: {error}, but the state changed");
            Some(error)
        }
    }
}

/// Previews the beginning of a body, and all of it, which must give the state after the frame.
fn check_preview(state: &State, body: &[u8], cut: usize) {
    let part = preview(state, &body[..cut % (body.len() + 1)], &LIMITS);
    let whole = preview(state, body, &LIMITS);
    if let (Ok(Some(part)), Ok(Some(whole))) = (&part, &whole) {
        assert!(part.sections <= whole.sections);
        assert!(part.state.present_points() <= whole.state.present_points());
    }
    let mut applied = state.clone();
    if Decoder::new().decode(&mut applied, body, &LIMITS).is_ok() {
        assert!(whole.is_ok(), "{whole:?}");
        assert!(whole.is_ok_and(|whole| whole.is_none_or(|whole| whole.state == applied)));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sound_frames_are_taken() {
        let samples = samples().unwrap();
        assert_eq!(samples.len(), 32);
        for sample in samples {
            assert_eq!(check_apply(&sample.before, &sample.body), None);
        }
        // The late keyframes carry a context.
        let info = crate::envelope::inspect(&samples[3].body, &LIMITS).unwrap();
        assert!(info.section(SectionTag::CONTEXT).is_some());
        for patches in samples[16..].chunks(4) {
            let tags = |sample: &Sample| {
                let info = crate::envelope::inspect(&sample.body, &LIMITS).unwrap();
                info.sections.iter().map(|section| section.tag).collect::<Vec<_>>()
            };
            let both = [SectionTag::CONTEXT, SectionTag::PATCH];
            assert_eq!([0, 1, 2, 3].map(|at| tags(&patches[at])), [&both[1..], &both[1..], &both, &both]);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(150))]

        #[test]
        fn encoder_decoder_and_references_agree(data in prop::collection::vec(any::<u8>(), 0..200)) {
            surface_round_trip(&data);
        }

        #[test]
        fn damaged_frames_do_no_harm(data in prop::collection::vec(any::<u8>(), 0..300)) {
            surface_decode(&data);
        }

        #[test]
        fn frames_with_one_byte_changed_do_no_harm(mode in any::<u8>(), at in any::<u16>(), change in any::<u8>()) {
            let [low, high] = at.to_le_bytes();
            surface_decode(&[mode & 0x8F, low, high, change]);
        }

        #[test]
        fn sections_of_noise_do_no_harm(
            mode in 32_u8..48, tag in 4_u8..9, coder in 0_u8..4, sizes in prop::array::uniform2(1_u16..400),
            noise in prop::collection::vec(any::<u8>(), 0..400),
        ) {
            let sizes = sizes.map(u16::to_le_bytes);
            let mode = if tag == 8 { mode | 0x80 } else { mode };
            surface_decode(&[&[mode, tag, coder][..], sizes.as_flattened(), &noise].concat());
        }
    }
}
