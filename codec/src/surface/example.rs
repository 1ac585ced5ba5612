//! The examples of the specification: bodies that it writes out byte by byte, decision by decision.

use std::sync::Arc;

use super::model::change::ChangeModel;
use super::model::curve;
use super::prediction::NextValues;
use super::section::changes::Changes;
use super::*;
use crate::Limits;
use crate::block::BlockCoder;
use crate::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use crate::hash::{RecordKind, term};
use crate::paper::example::{SPEC, dump, fenced, hex};
use crate::range::{BinaryCoder, BitModel, RangeEncoder, logistic};

/// Returns the encoder of a floor of three points.
fn encoder() -> Encoder {
    let layout = SetLayout {
        origin: [0.0; 3],
        step: 0.25,
        extent: [3, 0, 3],
        normal_bits: 4,
        charts: 1,
        levels: Levels::default(),
        points: 0,
        kernel_radius: 0.5,
        digest: GeometryDigest::default(),
    };
    let floor = [[0.0, 0.0, 0.0], [0.25, 0.0, 0.5], [0.75, 0.0, 0.5]].map(|position| RestPoint {
        position,
        normal: [0.0, 1.0, 0.0],
        chart: 0,
    });
    let geometry = Arc::new(Geometry::round(layout, &floor).geometry);
    let layout = Layout::new(vec![*geometry.layout()], vec![Member { set: 0 }], &Limits::default()).unwrap();
    let settings = EncoderSettings::new(8, GeometrySource::Sent).with_arrival_threshold(1);
    Encoder::new(Arc::new(layout), vec![geometry], settings).unwrap()
}

/// Returns the keyframe and the delta after it.
fn frames(coder: BlockCoder) -> [EncodedFrame; 2] {
    let mut encoder = encoder();
    let meta = |kind, frame, changed_points| FrameMeta {
        kind,
        frame: FrameIndex(frame),
        time: StreamTime(16_667 * u64::from(frame)),
        changed_points,
    };
    for (point, ao) in [(0, 255), (1, 200), (2, 100)] {
        encoder.set_ao(point, ao).unwrap();
    }
    let key = encoder.finish(meta(FrameKind::Key, 1, 3), BlockCoder::Stored).unwrap();
    encoder.set_ao(1, 100).unwrap();
    [key, encoder.finish(meta(FrameKind::Delta, 2, 1), coder).unwrap()]
}

#[test]
fn the_dumps_in_the_specification_are_what_the_code_writes() {
    let [key, stored] = frames(BlockCoder::Stored);
    let [_, range] = frames(BlockCoder::Range);
    for (name, frame) in [("surface-keyframe", &key), ("surface-delta", &stored), ("range-delta", &range)] {
        assert_eq!(dump(name), frame.body, "{name}: the code writes\n{}", hex(&frame.body));
    }
    for delta in ["surface-delta", "range-delta"] {
        let mut state = State::new(Arc::clone(encoder().state().layout()));
        for name in ["surface-keyframe", delta] {
            Decoder::new().decode(&mut state, &dump(name), &Limits::default()).unwrap();
        }
        assert_eq!(state.values(0), [255, 104, 100]);
    }
}

#[test]
fn the_hash_in_the_specification_is_what_the_code_computes() {
    let [key, _] = frames(BlockCoder::Stored);
    let digest = encoder().state().layout().sets()[0].digest;
    let geometry = term(RecordKind::Geometry, 0, &state::geometry_words(digest));
    let values = [255, 200, 100].map(state::value_words);
    let points = [0, 1, 2].map(|padded| term(RecordKind::Value, padded, &values[padded as usize]));
    let sum = points.iter().fold(geometry, |sum, term| sum.wrapping_add(*term));
    assert_eq!(sum, key.info.hash.0);
    for value in [digest.0, geometry, points[0], points[1], points[2], sum] {
        assert!(SPEC.contains(&format!("`{value:016x}`")), "{value:016x} is not in the specification");
    }
}

/// Logs every decision.
struct DecisionLog<'a> {
    encoder: RangeEncoder<'a>,
    decisions: Vec<String>,
}

impl BinaryCoder for DecisionLog<'_> {
    fn bit(&mut self, one: u32, wanted: bool) -> bool {
        self.decisions.push(format!("{one} {}", if wanted { "yes" } else { "no" }));
        self.encoder.bit(one, wanted)
    }
}

#[test]
fn the_decisions_in_the_specification_are_those_of_the_code() {
    let [key, range] = frames(BlockCoder::Range);
    let mut state = State::new(Arc::clone(encoder().state().layout()));
    Decoder::new().decode(&mut state, &key.body, &Limits::default()).unwrap();
    let mut changes = Changes { quantum: 12, ..Changes::default() };
    changes.push(PaddedIndex(1), -8);
    let mut block = Vec::new();
    let mut log = DecisionLog { encoder: RangeEncoder::new(&mut block), decisions: Vec::new() };
    let made = (&mut Changes::default(), &mut NextValues::default());
    let fits = ChangeModel::new().code(&mut log, state.view(), &changes, made, 1, |_| false);
    assert_eq!(fits, Ok(()));
    let DecisionLog { encoder, decisions } = log;
    encoder.finish();
    assert!(range.body.ends_with(&block));
    let told = fenced("decisions").lines().map(|line| line.split_once('|').unwrap().0.trim().to_owned());
    assert_eq!(told.collect::<Vec<_>>(), decisions);
}

#[test]
fn the_figures_in_the_specification_are_those_of_the_code() {
    let flowing = SPEC.split_whitespace().collect::<Vec<_>>().join(" ");
    let words = ChangeModel::new().words().len();
    assert!(flowing.contains(&format!("{},{:03} words", words / 1000, words % 1000)), "{words} words");
    let stretch = |step: u32| logistic().stretch(BitModel::from_word(step << 20).unwrap());
    let line = format!(
        "stretch[0] is {}, stretch[1024] is {} and stretch[4095] is {}",
        stretch(0),
        stretch(1024),
        stretch(4095)
    );
    assert!(flowing.contains(&line), "the specification lacks {line:?}");
    let places = [[0, 0, 0], [3, 0, 2], [1, 0, 2]].map(curve::place);
    let line = format!("{}, {} and {}.", places[0], places[1], places[2]);
    assert!(flowing.contains(&line), "the specification lacks {line:?}");
    let first: Vec<String> = (0..8)
        .map(|place| {
            (0..8).map(|n| [n & 1, n >> 1 & 1, n >> 2]).find(|node| curve::place(*node) == place).unwrap()
        })
        .map(|[x, y, z]| format!("({x}, {y}, {z})"))
        .collect();
    assert!(flowing.contains(&first.join(", ")), "the specification lacks {first:?}");
}
