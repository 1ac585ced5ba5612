//! The example of the specification: a frame that it writes out byte by byte.

use std::fmt::Write;
use std::sync::Arc;

use super::{Encoder, Grid, InstanceLayout, Layout, PointFormat, PointSample, Pose, State, apply};
use crate::Limits;
use crate::block::BlockCoder;
use crate::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use crate::hash::{RecordKind, term};

pub(crate) const SPEC: &str = include_str!("../../../docs/spec/codec.md");

const FLOOR: PointSample = PointSample { local: [0.3, 0.1, 0.6], normal: [0.0, 1.0, 0.0], ao: 200 };

fn encoder() -> Encoder {
    let grid = Grid::new([0.0; 3], 0.25, [4, 4, 4]).unwrap();
    let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 8, kernel_radius: 0.125 };
    let layout = Layout::new(PointFormat::Bits32, vec![instance], 64, &Limits::default()).unwrap();
    let mut encoder = Encoder::new(Arc::new(layout), &[1]).unwrap();
    encoder.put(0, &FLOOR).unwrap();
    encoder.set_pose(0, Pose { translation: [1.0, 2.0, 3.0], ..Pose::IDENTITY }).unwrap();
    encoder
}

fn meta(kind: FrameKind, frame: u32) -> FrameMeta {
    FrameMeta { kind, frame: FrameIndex(frame), time: StreamTime(16_667), changed_points: 1 }
}

/// Returns a stored keyframe with one pose, one bucket and one cell.
pub(crate) fn key() -> EncodedFrame {
    encoder().finish(meta(FrameKind::Key, 1), BlockCoder::Stored).unwrap()
}

/// Returns a fenced block of the specification.
pub(crate) fn fenced(name: &str) -> &'static str {
    let (_, rest) = SPEC.split_once(&format!("```{name}\n")).unwrap();
    rest.split_once("```").unwrap().0
}

/// Returns the bytes of a fenced block of the specification, whose lines are `offset bytes | meaning`.
pub(crate) fn dump(name: &str) -> Vec<u8> {
    let mut out = Vec::new();
    for line in fenced(name).lines() {
        let (offset, rest) = line.split_once(' ').unwrap();
        assert_eq!(offset.parse::<usize>().unwrap(), out.len(), "offset of {line:?}");
        let (bytes, _) = rest.split_once('|').unwrap();
        out.extend(bytes.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()));
    }
    out
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    let mut out = String::new();
    for (at, byte) in bytes.iter().enumerate() {
        let end = if at % 16 == 15 { "\n" } else { " " };
        write!(out, "{byte:02x}{end}").unwrap();
    }
    out
}

#[test]
fn the_dumps_in_the_specification_are_what_the_code_writes() {
    let mut encoder = encoder();
    let key = encoder.finish(meta(FrameKind::Key, 1), BlockCoder::Stored).unwrap();
    encoder.put(0, &PointSample { ao: 100, ..FLOOR }).unwrap();
    let delta = encoder.finish(meta(FrameKind::Delta, 2), BlockCoder::Stored).unwrap();
    for (name, frame) in [("keyframe", &key), ("delta", &delta)] {
        let written = dump(name);
        assert_eq!(written, frame.body, "{name}: the code writes\n{}", hex(&frame.body));
    }
    let mut state = State::new(Arc::clone(encoder.state().layout()));
    for name in ["keyframe", "delta"] {
        apply(&mut state, &dump(name), &Limits::default()).unwrap();
    }
    assert_eq!(&state, encoder.state());
}

#[test]
fn the_hash_in_the_specification_is_what_the_code_computes() {
    let mut encoder = encoder();
    encoder.finish(meta(FrameKind::Key, 1), BlockCoder::Stored).unwrap();
    let state = encoder.state();
    let terms = [
        term(RecordKind::Pose, 0, &state.poses()[0].hash_words()),
        term(RecordKind::Bucket, 1, &state.buckets()[1].to_words()),
        term(RecordKind::Cell, 0, state.cells()[0].words()),
    ];
    assert_eq!(terms.iter().fold(0_u64, |sum, term| sum.wrapping_add(*term)), state.hash().0);
    for value in [&terms[..], &[state.hash().0]].concat() {
        assert!(SPEC.contains(&format!("`{value:016x}`")), "{value:016x} is not in the specification");
    }
}

#[test]
fn the_words_in_the_specification_are_what_the_packings_make() {
    let frac = [6.0 / 31.0, 12.0 / 31.0, 12.0 / 31.0];
    for format in PointFormat::ALL {
        let word = format.pack(frac, FLOOR.normal, FLOOR.ao);
        let line = format!("| {}-bit | `{word:0width$x}` |", format.bits(), width = 2 * format.bytes());
        assert!(SPEC.contains(&line), "the specification lacks {line}");
    }
}
