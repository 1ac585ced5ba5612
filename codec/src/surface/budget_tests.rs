//! Tests of streams with a byte budget: the stated bounds of bytes, error and waiting, and the benefit of the order.

use proptest::prelude::*;

use super::tests::{CODERS, client, meta, set_frame_ao, stream, stream_sets, stream_with};
use super::*;
use crate::Limits;
use crate::block::BlockCoder;
use crate::envelope::{EncodedFrame, FrameKind, SectionTag};
use crate::reference::SurfaceReferenceEncoder;

const KEY: FrameKind = FrameKind::Key;
const DELTA: FrameKind = FrameKind::Delta;

/// Returns settings of the tests' stream with a budget. Points are predicted from their parents if `predicted` is set.
fn settings(predicted: bool, threshold: u8, bytes: u32, longest_age: u16) -> EncoderSettings {
    let source = if predicted { GeometrySource::Sent } else { GeometrySource::Shared };
    EncoderSettings::new(threshold, source).with_budget(Some(Budget { bytes, longest_age }))
}

/// Returns the encoder of the tests' stream with a budget, whose points are not predicted from each other.
fn budgeted(threshold: u8, bytes: u32, longest_age: u16) -> Encoder {
    stream_with(settings(false, threshold, bytes, longest_age))
}

/// Returns the reference of an encoder in which nothing was set.
fn reference_of(encoder: &Encoder) -> SurfaceReferenceEncoder {
    let layout = std::sync::Arc::clone(encoder.state().layout());
    SurfaceReferenceEncoder::new(layout, &stream_sets(), *encoder.settings())
}

/// Pseudo-random numbers from a seed.
struct Dice(u32);

impl Dice {
    fn roll(&mut self, sides: u32) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) % sides
    }
}

/// AO of every point, which wanders: most points a little, some far.
struct Walk {
    ao: Vec<u8>,
    dice: Dice,
}

impl Walk {
    fn new(points: u32, seed: u32) -> Walk {
        Walk { ao: vec![200; points as usize], dice: Dice(seed) }
    }

    fn step(&mut self, jump: u32) {
        for ao in &mut self.ao {
            let most = if self.dice.roll(10) == 0 { jump } else { jump / 8 + 1 };
            let by = self.dice.roll(2 * most + 1) as i32 - most as i32;
            *ao = (i32::from(*ao) + by).clamp(0, 255) as u8;
        }
    }

    fn set_ao(&self, encoder: &mut Encoder) {
        for (point, ao) in (0..).zip(&self.ao) {
            encoder.set_ao(point, *ao).unwrap();
        }
    }
}

/// Returns the AO of clients, in the order of point ids.
fn held(state: &State) -> Vec<u8> {
    (0..state.layout().members().len() as u32).flat_map(|instance| state.values(instance)).copied().collect()
}

fn changes(frame: &EncodedFrame) -> usize {
    frame.info.section(SectionTag::CHANGES).map_or(0, |section| section.records as usize)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn no_body_is_too_large_and_no_point_too_late(
        threshold in 1_u8..20, bytes in 29_u32..300, longest_age in 0_u16..9, jump in 4_u32..100, seed: u32,
        coder in 0_usize..4, predicted: bool,
    ) {
        let mut encoder = stream_with(settings(predicted, threshold, bytes, longest_age));
        let mut reference = reference_of(&encoder);
        let mut state = client(&encoder);
        let mut decoder = Decoder::new();
        let mut walk = Walk::new(state.layout().points(), seed);
        let mut latest: Vec<Vec<u8>> = Vec::new();
        let mut beyond = vec![0; walk.ao.len()];
        for number in 0..30 {
            let (instance, block, weight) = (walk.dice.roll(4), walk.dice.roll(5) as usize, walk.dice.roll(200) as u16);
            encoder.set_weight(instance, block, weight);
            reference.set_weight(instance, block, weight);
            walk.set_ao(&mut encoder);
            (0..).zip(&walk.ao).for_each(|(point, ao)| { reference.set_ao(point, *ao); });
            let kind = if number == 0 { KEY } else { DELTA };
            let frame = encoder.finish(meta(kind, number), CODERS[coder]).unwrap();
            decoder.decode(&mut state, &frame.body, &Limits::default()).unwrap();
            prop_assert_eq!(&state, encoder.state());
            let postponed = *encoder.postponed().unwrap();
            prop_assert_eq!(postponed.used as usize, frame.body.len());
            prop_assert!(postponed.oldest <= longest_age);
            let kept = frame.body.len() <= bytes as usize;
            let held = held(&state);
            reference.begin();
            if kind == DELTA {
                let (mut ranked, forced) = reference.ranked();
                let allowed = reference.explain(changes(&frame), &held).unwrap();
                prop_assert!(kept || allowed == forced && changes(&frame) == postponed.forced as usize, "{postponed:?}");
                ranked.truncate(allowed);
                prop_assert_eq!(postponed.forced, reference.late(&ranked));
                reference.finish(DELTA, &ranked);
            } else {
                reference.finish(KEY, &[]);
            }
            latest.push(walk.ao.clone());
            let late = latest.len().min(usize::from(longest_age) + 1);
            let last = &latest[latest.len() - late..];
            for (point, held) in held.into_iter().enumerate() {
                prop_assert_eq!(Some(held), reference.held(point as u32));
                let most = encoder.threshold(point as u32).unwrap();
                let near = (walk.ao[point] == NO_VALUE) == (held == NO_VALUE) && walk.ao[point].abs_diff(held) < most;
                beyond[point] = if near { 0 } else { beyond[point] + 1 };
                prop_assert!(beyond[point] <= longest_age, "point {point} in frame {number}");
                let near = last.iter().any(|latest| latest[point].abs_diff(held) < threshold);
                prop_assert!(near || predicted, "point {point} in frame {number}");
            }
            walk.step(jump);
        }
    }

    #[test]
    fn a_budget_that_every_frame_keeps_changes_no_byte(
        threshold in 1_u8..20, jump in 4_u32..60, seed: u32, coder in 0_usize..4, spare in 0_u32..2, predicted: bool,
    ) {
        let run = |mut encoder: Encoder| -> Vec<Vec<u8>> {
            let mut walk = Walk::new(encoder.state().layout().points(), seed);
            (0..12).map(|number| {
                let late = if number < 3 { 300 } else { walk.ao.len() };
                for (point, ao) in (0..).zip(&walk.ao[..late]) {
                    encoder.set_ao(point, *ao).unwrap();
                }
                let kind = if number % 9 == 0 { KEY } else { DELTA };
                let body = encoder.finish(meta(kind, number), CODERS[coder]).unwrap().body;
                walk.step(jump);
                body
            }).collect()
        };
        let source = if predicted { GeometrySource::Sent } else { GeometrySource::Shared };
        let plain = run(stream(source, threshold));
        let most = plain.iter().map(Vec::len).max().unwrap() as u32 + spare;
        prop_assert!(run(stream_with(settings(predicted, threshold, most, 3))) == plain);
    }

    /// Checks, with no point forced and none predicted from others, the bound of [`Budget`] from what was measured of the
    /// stream and the sizes of the plain layout.
    #[test]
    fn nobody_waits_longer_than_the_budget_says(threshold in 4_u8..12, jump in 40_u32..100, seed: u32) {
        const BYTES: usize = 200;
        let mut encoder = budgeted(threshold, BYTES as u32, u16::MAX);
        let layout = std::sync::Arc::clone(encoder.state().layout());
        let mut reference = reference_of(&encoder);
        let mut walk = Walk::new(layout.points(), seed);
        let (mut due, mut longest) = (0, 0);
        let (mut least, mut largest) = (u64::MAX, 0);
        // Header, quantum and bitmap of blocks; a mask and a level for each point at worst.
        let (fixed, each) = (50 + 1 + layout.blocks().div_ceil(8), 8 + 2);
        let sent_at_least = (BYTES * 15 / 16 - fixed) / each - 1;
        for number in 0..200 {
            walk.set_ao(&mut encoder);
            for (point, ao) in (0..).zip(&walk.ao) {
                reference.set_ao(point, *ao);
            }
            let kind = if number == 0 { KEY } else { DELTA };
            reference.begin();
            let (mut ranked, _) = reference.ranked();
            if kind == DELTA {
                due = due.max(ranked.len());
                for point in &ranked {
                    let product = reference.priority(*point) / (reference.waited(*point) + 1);
                    (least, largest) = (least.min(product), largest.max(product));
                }
            }
            let frame = encoder.finish(meta(kind, number), BlockCoder::Stored).unwrap();
            let sent = changes(&frame);
            let postponed = *encoder.postponed().unwrap();
            prop_assert!(postponed.points == 0 || sent >= sent_at_least, "{sent} of {}", ranked.len());
            ranked.truncate(sent);
            reference.finish(kind, &ranked);
            longest = longest.max(usize::from(postponed.oldest));
            walk.step(jump);
        }
        let rounds = due.div_ceil(sent_at_least);
        let bound = (largest as f64 / least as f64 + 1.0) * rounds as f64;
        // If everything fits, the test shows nothing.
        prop_assume!(longest > 0);
        prop_assert!(longest as f64 <= bound, "{longest} frames, {bound} allowed");
    }
}

#[test]
fn most_of_a_budget_is_used_while_points_wait() {
    // What is predicted takes fewer bytes, so more has to move.
    for (coder, predicted, jump) in
        CODERS.into_iter().flat_map(|coder| [(coder, false, 30), (coder, true, 60)])
    {
        let mut encoder = stream_with(settings(predicted, 4, 150, 30));
        let mut walk = Walk::new(encoder.state().layout().points(), 5);
        let mut waited = 0;
        for number in 0..40 {
            walk.set_ao(&mut encoder);
            let frame = encoder.finish(meta(if number == 0 { KEY } else { DELTA }, number), coder).unwrap();
            let postponed = encoder.postponed().unwrap();
            if postponed.points > 0 && postponed.forced == 0 {
                waited += 1;
                assert!((125..=150).contains(&frame.body.len()), "{coder:?}: {postponed:?}");
                assert_eq!(frame.info.changed_points as usize, changes(&frame));
            }
            walk.step(jump);
        }
        assert!(waited > 10, "{coder:?}: {waited}");
    }
}

#[test]
fn a_keyframe_sends_what_waits() {
    // Points arrive with the bytes set.
    let mut encoder = stream_with(settings(false, 4, 60, 30).with_arrival_threshold(1));
    let all = 0..encoder.state().layout().points();
    set_frame_ao(&mut encoder, 0, all.clone());
    encoder.finish(meta(KEY, 0), BlockCoder::Range).unwrap();
    set_frame_ao(&mut encoder, 7, all);
    encoder.finish(meta(DELTA, 1), BlockCoder::Range).unwrap();
    assert!(encoder.postponed().unwrap().points > 100);
    let body = encoder.finish(meta(KEY, 2), BlockCoder::Range).unwrap().body;
    let nothing = Postponed { used: body.len() as u32, ..Postponed::default() };
    assert_eq!(encoder.postponed(), Some(&nothing));
    let still = encoder.finish(meta(DELTA, 3), BlockCoder::Range).unwrap();
    assert_eq!((changes(&still), encoder.postponed().unwrap().points), (0, 0));
    for instance in 0..4 {
        assert_eq!(encoder.latest(instance), encoder.state().values(instance));
    }
    assert!(encoder.latest(4).is_empty());
}

#[test]
fn a_frame_that_fails_leaves_those_that_wait_as_they_were() {
    let bodies = |fails: bool| -> Vec<Vec<u8>> {
        let mut encoder = budgeted(4, 90, 5);
        let points = encoder.state().layout().points();
        (0..12)
            .map(|number| {
                set_frame_ao(&mut encoder, 2 * number, 0..points);
                let kind = if number == 0 { KEY } else { DELTA };
                if fails && number > 0 {
                    let none = BlockCoder::Zstd { level: 99 };
                    assert!(encoder.finish(meta(kind, number), none).is_err());
                }
                encoder.finish(meta(kind, number), CODERS[number as usize % 4]).unwrap().body
            })
            .collect()
    };
    assert!(bodies(true) == bodies(false));
}

/// Compares three orders of the same number of points in each frame, by the weighted mean error of clients.
#[test]
fn the_order_beats_that_of_age_alone() {
    let mut encoder = budgeted(4, 110, 200);
    let layout = std::sync::Arc::clone(encoder.state().layout());
    let [mut by_product, mut by_age] = [reference_of(&encoder), reference_of(&encoder)];
    let mut walk = Walk::new(layout.points(), 77);
    let mut weights = Vec::new();
    for instance in 0..4 {
        for (block, _) in layout.blocks_of(instance).enumerate() {
            let weight = 1 << walk.dice.roll(10);
            encoder.set_weight(instance, block, weight);
            by_product.set_weight(instance, block, weight);
            by_age.set_weight(instance, block, weight);
            let points = layout.points_of(instance).len() - block * BLOCK_POINTS;
            weights.extend(std::iter::repeat_n(u64::from(weight), points.min(BLOCK_POINTS)));
        }
    }
    let mut off = [0_u64; 2];
    for number in 0..150 {
        walk.set_ao(&mut encoder);
        for (point, ao) in (0..).zip(&walk.ao) {
            by_product.set_ao(point, *ao);
            by_age.set_ao(point, *ao);
        }
        let kind = if number == 0 { KEY } else { DELTA };
        let sent = changes(&encoder.finish(meta(kind, number), BlockCoder::Range).unwrap());
        let chosen = by_product.ranked().0;
        by_product.finish(kind, &chosen[..sent]);
        let mut oldest = by_age.due();
        oldest.sort_by_key(|point| std::cmp::Reverse(by_age.waited(*point)));
        oldest.truncate(sent);
        by_age.finish(kind, &oldest);
        for (reference, off) in [&by_product, &by_age].into_iter().zip(&mut off) {
            for ((point, ao), weight) in (0..).zip(&walk.ao).zip(&weights) {
                *off += weight * u64::from(reference.held(point).unwrap().abs_diff(*ao));
            }
        }
        assert_eq!(
            held(encoder.state()),
            (0..layout.points()).filter_map(|at| by_product.held(at)).collect::<Vec<_>>()
        );
        walk.step(30);
    }
    assert!(off[0] * 4 < off[1] * 3, "{off:?}");
}
