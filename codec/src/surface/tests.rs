//! Streams of made-up scenes through encoder, decoder and keyframes.

use std::sync::Arc;

use proptest::prelude::*;

use super::section::geometry;
use super::section::writer::FrameModels;
use super::*;
use crate::Limits;
use crate::block::BlockCoder;
use crate::envelope::{
    EncodedFrame, FrameError, FrameIndex, FrameKind, FrameMeta, SectionTag, StreamTime, inspect,
};
use crate::testing::reseal;

pub(super) const CODERS: [BlockCoder; 4] =
    [BlockCoder::Range, BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::Zstd { level: 15 }];

/// Returns a floor and a ball, with points on a Fibonacci lattice; nothing is random.
fn geometries() -> Vec<Arc<Geometry>> {
    let layout = |extent| SetLayout {
        origin: [-1.0, -1.0, -1.0],
        step: 1.0 / 128.0,
        extent,
        normal_bits: 6,
        points: 0,
        charts: 2,
        levels: Levels::default(),
        kernel_radius: 0.1,
        digest: GeometryDigest::default(),
    };
    let turn = |n: u32| f64::from(n) * 2.399_963_229_728_653;
    let floor = (0..300).map(|n| {
        let radius = (f64::from(n) / 300.0).sqrt();
        let [x, z] = [radius * turn(n).cos(), radius * turn(n).sin()];
        RestPoint { position: [x as f32, 0.0, z as f32], normal: [0.0, 1.0, 0.0], chart: u32::from(x > 0.3) }
    });
    let ball = (0..130).map(|n| {
        let y = 1.0 - (f64::from(n) + 0.5) / 65.0;
        let ring = (1.0 - y * y).sqrt();
        let position = [ring * turn(n).cos(), y, ring * turn(n).sin()].map(|axis| axis as f32);
        RestPoint { position, normal: position, chart: u32::from(y > 0.0) }
    });
    let round = |points: Vec<RestPoint>| Arc::new(Geometry::round(layout([256; 3]), &points).geometry);
    vec![round(floor.collect()), round(ball.collect())]
}

/// Returns the sets of the stream: the floor, the ball and one without points.
pub(super) fn stream_sets() -> Vec<Arc<Geometry>> {
    let geometry = geometries();
    let empty = Geometry::round(*geometry[0].layout(), &[]).geometry;
    geometry.into_iter().chain([Arc::new(empty)]).collect()
}

/// Returns a stream of the floor, two balls and an empty instance.
pub(super) fn stream(source: GeometrySource, threshold: u8) -> Encoder {
    stream_with(EncoderSettings::new(threshold, source))
}

pub(super) fn stream_with(settings: EncoderSettings) -> Encoder {
    let geometry = stream_sets();
    let sets = geometry.iter().map(|geometry| *geometry.layout()).collect();
    let members = [0, 1, 2, 1].map(|set| Member { set }).to_vec();
    let layout = Arc::new(Layout::new(sets, members, &Limits::default()).unwrap());
    Encoder::new(layout, geometry, settings).unwrap()
}

/// Returns a client that has received nothing.
pub(super) fn client(encoder: &Encoder) -> State {
    let mut state = State::new(Arc::clone(encoder.state().layout()));
    if encoder.settings().geometry == GeometrySource::Shared {
        for set in 0..3 {
            state.share_geometry(set, Arc::clone(encoder.state().geometry(set).unwrap())).unwrap();
        }
    }
    state
}

pub(super) fn meta(kind: FrameKind, frame: u32) -> FrameMeta {
    FrameMeta { kind, frame: FrameIndex(frame), time: StreamTime(u64::from(frame) * 1000), changed_points: 0 }
}

/// Returns the AO of a point at a given time: a shadow passes over open ground, with a little noise.
pub(super) fn ao(point: u32, frame: u32) -> u8 {
    let distance = (f64::from(point % 130) - 5.0 * f64::from(frame)).abs();
    let noise = (point.wrapping_mul(0x9E37_79B9).wrapping_add(frame * 77) >> 20) % 5;
    (255.0 - 160.0 * (-distance * distance / 300.0).exp()) as u8 - noise as u8
}

pub(super) fn set_frame_ao(encoder: &mut Encoder, frame: u32, points: std::ops::Range<u32>) {
    for point in points {
        encoder.set_ao(point, ao(point, frame)).unwrap();
    }
}

/// Returns the frames of a short stream in which a ball arrives late.
fn frames(encoder: &mut Encoder, coder: BlockCoder, count: u32) -> Vec<EncodedFrame> {
    let all = encoder.state().layout().points();
    let frame = |encoder: &mut Encoder, frame: u32| {
        let late = if frame < 2 { all - 130 } else { all };
        set_frame_ao(encoder, frame, 0..late);
        let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
        encoder.finish(meta(kind, frame), coder).unwrap()
    };
    (0..count).map(|number| frame(encoder, number)).collect()
}

#[test]
fn clients_hold_what_the_server_says_with_every_coder() {
    for coder in CODERS {
        for source in [GeometrySource::Sent, GeometrySource::Shared] {
            let mut encoder = stream(source, 8);
            let mut state = client(&encoder);
            let mut decoder = Decoder::new();
            for number in 0..12 {
                let frame = frames_next(&mut encoder, coder, number);
                assert_eq!(inspect(&frame.body, &Limits::default()).as_ref(), Ok(&frame.info));
                let info = decoder.decode(&mut state, &frame.body, &Limits::default()).unwrap();
                assert_eq!(info, frame.info);
                assert_eq!(&state, encoder.state(), "{coder:?} {source:?} frame {number}");
                assert_eq!(state.hash(), state.full_hash());
            }
        }
    }
}

fn frames_next(encoder: &mut Encoder, coder: BlockCoder, number: u32) -> EncodedFrame {
    let all = encoder.state().layout().points();
    set_frame_ao(encoder, number, 0..if number < 2 { all - 130 } else { all });
    let kind = if number.is_multiple_of(9) { FrameKind::Key } else { FrameKind::Delta };
    encoder.finish(meta(kind, number), coder).unwrap()
}

#[test]
fn the_range_coder_takes_the_fewest_bytes() {
    let bytes = |coder| -> usize {
        frames(&mut stream(GeometrySource::Sent, 8), coder, 30).iter().map(|frame| frame.body.len()).sum()
    };
    let [range, stored, lz4, zstd] = CODERS.map(bytes);
    assert!(range < zstd && zstd < lz4 && lz4 < stored, "{range} {zstd} {lz4} {stored}");
}

#[test]
fn a_still_stream_costs_a_header_a_frame() {
    let mut encoder = stream(GeometrySource::Sent, 8);
    frames(&mut encoder, BlockCoder::Range, 3);
    let frame = encoder.finish(meta(FrameKind::Delta, 9), BlockCoder::Range).unwrap();
    assert_eq!((frame.body.len(), frame.info.sections.len()), (29, 0));
}

#[test]
fn a_keyframe_in_the_middle_of_a_group_lets_a_client_read_on() {
    for coder in CODERS {
        let mut encoder = stream(GeometrySource::Sent, 4);
        frames(&mut encoder, coder, 6);
        let order = [(3, 1), (3, 9), (0, 2), (99, 0)];
        let body = keyframe(encoder.state(), meta(FrameKind::Key, 5), coder, &order).unwrap();
        let mut late = client(&encoder);
        let mut decoder = Decoder::new();
        decoder.decode(&mut late, &body, &Limits::default()).unwrap();
        assert_eq!(&late, encoder.state());
        for number in 6..9 {
            set_frame_ao(&mut encoder, number, 0..100);
            let frame = encoder.finish(meta(FrameKind::Delta, number), coder).unwrap();
            decoder.decode(&mut late, &frame.body, &Limits::default()).unwrap();
            assert_eq!(&late, encoder.state());
        }
    }
}

#[test]
fn what_the_bits_are_spent_on_adds_up_to_the_block() {
    let mut encoder = stream(GeometrySource::Sent, 2);
    frames(&mut encoder, BlockCoder::Range, 3);
    let before = encoder.state().clone();
    set_frame_ao(&mut encoder, 8, 0..before.layout().points());
    let frame = encoder.finish(meta(FrameKind::Delta, 8), BlockCoder::Range).unwrap();
    let bits = 8.0 * f64::from(frame.info.sections[0].wire_bytes);
    let BitBreakdown { blocks, points, signs, sizes } =
        bit_breakdown(&before, &frame.body, &Limits::default()).unwrap().unwrap();
    assert!([blocks, points, signs, sizes].iter().all(|part| *part > 0.0));
    assert!(
        (blocks + points + signs + sizes - bits).abs() < 12.0,
        "{blocks} {points} {signs} {sizes} of {bits}"
    );
    let still = encoder.finish(meta(FrameKind::Delta, 9), BlockCoder::Range).unwrap();
    assert_eq!(bit_breakdown(encoder.state(), &still.body, &Limits::default()), Ok(None));
}

#[test]
fn a_context_is_one_record() {
    let mut encoder = stream(GeometrySource::Sent, 4);
    frames(&mut encoder, BlockCoder::Stored, 6);
    let meta = meta(FrameKind::Key, 5);
    let body = keyframe(encoder.state(), meta, BlockCoder::Stored, &[]).unwrap();
    let mut info = inspect(&body, &Limits::default()).unwrap();
    let context = info.sections.iter_mut().find(|section| section.tag == SectionTag::CONTEXT);
    context.unwrap().records = 2;
    let ids = frame_ids(info.kind);
    let blocks = &body[info.header_bytes as usize..];
    let forged = crate::envelope::assemble(&meta, ids, info.hash, info.sections, blocks).body;
    let error = refuse(&mut Decoder::new(), &client(&encoder), &forged, &Limits::default());
    assert!(matches!(error, FrameError::TooManyRecords { records: 2, places: 1, .. }), "{error}");
    let expected = crate::reference::apply_surface(&client(&encoder), &forged, &Limits::default());
    assert!(expected.is_err());
}

#[test]
fn part_of_a_keyframe_can_be_shown() {
    let mut encoder = stream(GeometrySource::Sent, 8);
    let body = frames(&mut encoder, BlockCoder::Range, 1).remove(0).body;
    let empty = client(&encoder);
    let mut points = 0;
    let mut sections = 0;
    for end in 0..=body.len() {
        let Some(found) = preview(&empty, &body[..end], &Limits::default()).unwrap() else { continue };
        assert!(found.sections >= sections && found.state.present_points() >= points);
        (points, sections) = (found.state.present_points(), found.sections);
    }
    assert_eq!(points, u64::from(encoder.state().layout().points()) - 130);
    let whole = preview(&empty, &body, &Limits::default()).unwrap().unwrap();
    assert_eq!((&whole.state, whole.sections), (encoder.state(), whole.of));
}

/// Applies a body that must be refused; `state` must not change.
pub(super) fn refuse(decoder: &mut Decoder, state: &State, body: &[u8], limits: &Limits) -> FrameError {
    let mut found = state.clone();
    let error = decoder.decode(&mut found, body, limits).unwrap_err();
    assert_eq!(&found, state);
    error
}

/// Returns states and the frames that follow them: a keyframe, a delta with arrivals and one without.
fn samples(coder: BlockCoder) -> Vec<(State, EncodedFrame, State)> {
    let mut encoder = stream(GeometrySource::Sent, 8);
    let mut state = client(&encoder);
    (0..4)
        .map(|number| {
            let frame = frames_next(&mut encoder, coder, number);
            let before = std::mem::replace(&mut state, encoder.state().clone());
            (before, frame, state.clone())
        })
        .collect()
}

#[test]
fn every_prefix_and_every_flipped_bit_is_refused() {
    for coder in CODERS {
        let mut decoder = Decoder::new();
        for (state, frame, _) in samples(coder) {
            let body = frame.body;
            for end in (0..body.len()).step_by(1 + body.len() / 400) {
                refuse(&mut decoder, &state, &body[..end], &Limits::default());
            }
            for bit in (0..body.len() * 8).step_by(1 + body.len() / 200) {
                let mut changed = body.clone();
                changed[bit / 8] ^= 1 << (bit % 8);
                refuse(&mut decoder, &state, &changed, &Limits::default());
            }
        }
    }
}

#[test]
fn flipped_bits_under_a_right_checksum_are_refused_or_harmless() {
    for coder in CODERS {
        let mut decoder = Decoder::new();
        for (state, frame, after) in samples(coder) {
            let bits = frame.body.len() * 8;
            for bit in (0..bits).step_by(1 + bits / 1500) {
                let mut changed = frame.body.clone();
                changed[bit / 8] ^= 1 << (bit % 8);
                reseal(&mut changed);
                let mut found = state.clone();
                match decoder.decode(&mut found, &changed, &Limits::default()) {
                    Ok(_) => {
                        found.frame = after.frame;
                        assert_eq!((found.hash(), &found.values), (after.hash(), &after.values), "bit {bit}");
                    }
                    Err(_) => assert_eq!(found, state, "bit {bit}"),
                }
            }
        }
    }
}

#[test]
fn frames_out_of_order_and_of_the_other_profile_are_refused() {
    let mut decoder = Decoder::new();
    let samples = samples(BlockCoder::Range);
    let limits = Limits::default();
    let (empty, after) = (&samples[0].0, &samples[1].2);
    let delta = &samples[1].1.body;
    assert_eq!(refuse(&mut decoder, empty, delta, &limits), FrameError::NoKeyframe { offset: 2 });
    let (found, last) = (FrameIndex(1), FrameIndex(1));
    let error = refuse(&mut decoder, after, delta, &limits);
    assert_eq!(error, FrameError::FrameOrder { offset: 4, found, last });
    let paper = crate::paper::example::key().body;
    let error = refuse(&mut decoder, empty, &paper, &limits);
    assert!(matches!(error, FrameError::ProfileOther { offset: 0, .. }), "{error}");
    let error = refuse(&mut decoder, &samples[3].0, &samples[1].1.body, &limits);
    assert!(matches!(error, FrameError::FrameOrder { .. }), "{error}");
    let skipped = refuse(&mut decoder, &samples[1].0, &samples[2].1.body, &limits);
    assert!(matches!(
        skipped,
        FrameError::Hash { .. }
            | FrameError::Content { section: SectionTag::CHANGES, .. }
            | FrameError::RangeLength { .. }
    ));
}

#[test]
fn limits_are_kept() {
    let (state, frame, _) = samples(BlockCoder::Zstd { level: 1 }).remove(0);
    let largest = frame.info.sections.iter().map(|section| section.raw_bytes).max().unwrap();
    let limits = Limits { max_block_bytes: largest - 1, ..Limits::default() };
    let error = refuse(&mut Decoder::new(), &state, &frame.body, &limits);
    assert!(matches!(error, FrameError::BlockTooLarge { .. }), "{error}");
    let limits = Limits { max_points: 10, ..Limits::default() };
    let layout = state.layout();
    let error = Layout::new(layout.sets().to_vec(), layout.members().to_vec(), &limits);
    assert!(matches!(error, Err(LayoutError::Points { limit: 10, .. })));
    // Sets without an instance count too: a frame could bring them.
    let error = Layout::new(layout.sets().to_vec(), Vec::new(), &limits);
    assert_eq!(error, Err(LayoutError::Points { found: 430, limit: 10 }));
}

/// A set that came again and again, or one without points, would take memory out of proportion to the body.
#[test]
fn a_set_comes_once_and_with_points() {
    let encoder = stream(GeometrySource::Sent, 8);
    let state = client(&encoder);
    let floor = (0, geometries().remove(0));
    let empty = (2, Arc::new(Geometry::round(state.layout().sets()[2], &[]).geometry));
    for (sets, set) in [(vec![floor.clone(), floor], 0), (vec![empty; 50], 2)] {
        for coder in [BlockCoder::Stored, BlockCoder::Range] {
            let mut bits = Vec::new();
            let points = sets.iter().map(|(_, geometry)| geometry.len()).sum::<usize>().max(1) as u32;
            if coder == BlockCoder::Range {
                let mut models = FrameModels::new();
                let mut encoder = crate::range::RangeEncoder::new(&mut bits);
                models.sets.code(&mut encoder, sets.len() as u32);
                let mut next = 0;
                for (set, geometry) in &sets {
                    models.sets.code_signed(&mut encoder, *set as i32 - next);
                    next = *set as i32 + 1;
                    models.geometry.code(&mut encoder, geometry.layout(), Some(geometry), |_| false).unwrap();
                }
                encoder.finish();
            } else {
                geometry::write_plain(&sets, &mut bits);
            }
            let section = crate::envelope::SectionInfo {
                tag: SectionTag::GEOMETRY,
                coder: coder.id(),
                records: points,
                raw_bytes: geometry::plain_bytes(&sets) as u32,
                wire_bytes: bits.len() as u32,
            };
            let ids = frame_ids(FrameKind::Key);
            let meta = meta(FrameKind::Key, 0);
            let body = crate::envelope::assemble(&meta, ids, crate::StateHash(7), vec![section], &bits).body;
            let error = refuse(&mut Decoder::new(), &state, &body, &Limits::default());
            let expected = GeometrySectionError::Set { set };
            assert!(
                matches!(error, FrameError::Content { problem, .. } if problem == SectionError::from(expected).into()),
                "{coder:?}: {error}"
            );
        }
    }
}

#[test]
fn shared_geometry_must_be_the_stream_s() {
    let encoder = stream(GeometrySource::Shared, 8);
    let mut state = State::new(Arc::clone(encoder.state().layout()));
    let floor = Arc::clone(encoder.state().geometry(0).unwrap());
    assert_eq!(state.share_geometry(1, Arc::clone(&floor)), Err(GeometryError::Other { set: 1 }));
    assert_eq!(state.share_geometry(9, Arc::clone(&floor)), Err(GeometryError::NoSet { set: 9 }));
    assert_eq!(state.share_geometry(0, floor), Ok(()));
    assert_eq!((state.hash().0, state.geometry(0).is_some(), state.geometry(1).is_some()), (0, true, false));
}

#[test]
fn a_set_without_points_cannot_come_for_ever() {
    // Set 2 has no points, so the number of points does not tell how often it comes.
    let encoder = stream(GeometrySource::Sent, 8);
    let state = client(&encoder);
    let floor = encoder.state().layout().sets()[0].points;
    let raw = [2_u32.to_le_bytes(); 1000].concat();
    let section = crate::envelope::SectionInfo {
        tag: SectionTag::GEOMETRY,
        coder: crate::block::CoderId::STORED,
        records: floor,
        raw_bytes: raw.len() as u32,
        wire_bytes: raw.len() as u32,
    };
    let ids = frame_ids(FrameKind::Key);
    let hash = crate::StateHash::default();
    let body = crate::envelope::assemble(&meta(FrameKind::Key, 0), ids, hash, vec![section], &raw).body;
    let error = refuse(&mut Decoder::new(), &state, &body, &Limits::default());
    assert!(
        matches!(error, FrameError::Content { problem, .. } if problem == SectionError::from(GeometrySectionError::Set { set: 2 }).into()),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn clients_are_never_off_by_the_threshold(
        threshold in 1_u8..=255,
        coder in 0_usize..4,
        source in any::<bool>(),
        steps in prop::collection::vec(prop::collection::vec((0_u32..560, any::<u8>()), 0..80), 1..12),
    ) {
        let source = if source { GeometrySource::Sent } else { GeometrySource::Shared };
        let mut encoder = stream(source, threshold);
        let mut state = client(&encoder);
        let mut decoder = Decoder::new();
        let mut now = vec![None; 560];
        for (offers, number) in steps.iter().zip(0..) {
            for (point, ao) in offers {
                now[*point as usize] = Some(*ao);
                encoder.set_ao(*point, *ao);
            }
            let kind = if u32::is_multiple_of(number, 5) { FrameKind::Key } else { FrameKind::Delta };
            let frame = encoder.finish(meta(kind, number), CODERS[coder]).unwrap();
            decoder.decode(&mut state, &frame.body, &Limits::default()).unwrap();
            prop_assert_eq!(&state, encoder.state());
            for (point, ao) in now.iter().enumerate() {
                let index = state.layout.padded_index(point as u32).unwrap();
                let Some(most) = encoder.threshold(point as u32) else {
                    prop_assert!(ao.is_none() && !state.present[index.block()]);
                    continue;
                };
                let Some(ao) = ao else {
                    prop_assert_eq!(most, 255);
                    continue;
                };
                let held = state.values[index.0];
                prop_assert_eq!(held == NO_VALUE, *ao == NO_VALUE);
                let error = held.abs_diff(*ao);
                prop_assert!(error < most, "{point}: off by {error} of {most}");
                prop_assert!(most - 1 <= encoder.settings().max_error());
                prop_assert!(most == threshold || source == GeometrySource::Sent);
            }
        }
        prop_assert_eq!(encoder.set_ao(560, 1), None);
    }

    #[test]
    fn noise_is_refused_or_has_the_right_hash(
        noise in prop::collection::vec(any::<u8>(), 0..200), tag in 4_u8..9, coder in 0_u8..4, records in 1_u32..600,
        key in any::<bool>(),
    ) {
        let (state, ..) = &samples(BlockCoder::Range)[usize::from(!key) * 3];
        let meta = meta(if key { FrameKind::Key } else { FrameKind::Delta }, 100);
        let section = crate::envelope::SectionInfo {
            tag: SectionTag(tag),
            coder: crate::block::CoderId(coder),
            records,
            raw_bytes: noise.len() as u32,
            wire_bytes: noise.len() as u32,
        };
        let ids = frame_ids(meta.kind);
        let body = crate::envelope::assemble(&meta, ids, crate::StateHash(7), vec![section], &noise).body;
        let mut found = state.clone();
        if Decoder::new().decode(&mut found, &body, &Limits::default()).is_err() {
            prop_assert_eq!(&found, state);
        }
    }
}
