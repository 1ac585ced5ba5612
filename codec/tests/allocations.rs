//! What is allocated for a frame of changes alone, once buffers have grown.

#![expect(clippy::unwrap_used, reason = "this is a test, its helpers included")]

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{EncodedFrame, FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::surface::{
    Budget, Decoder, Encoder, EncoderSettings, Geometry, GeometryDigest, GeometrySource, Layout, Levels,
    Member, RestPoint, SetLayout, State,
};

const POINTS: u32 = 2000;
const CODERS: [BlockCoder; 4] =
    [BlockCoder::Range, BlockCoder::Stored, BlockCoder::Lz4, BlockCoder::Zstd { level: 15 }];

/// One floor.
fn encoder(budget: Option<Budget>) -> Encoder {
    let layout = SetLayout {
        origin: [0.0; 3],
        step: 0.01,
        extent: [100; 3],
        normal_bits: 6,
        charts: 1,
        levels: Levels::default(),
        points: 0,
        kernel_radius: 0.1,
        digest: GeometryDigest::default(),
    };
    let at = |n: u32| RestPoint {
        position: [(n % 50) as f32 / 50.0, 0.0, (n / 50) as f32 / 50.0],
        normal: [0.0, 1.0, 0.0],
        chart: 0,
    };
    let points: Vec<RestPoint> = (0..POINTS).map(at).collect();
    let geometry = Geometry::round(layout, &points).geometry;
    let sets = vec![*geometry.layout()];
    let layout = Arc::new(Layout::new(sets, vec![Member { set: 0 }], &Limits::default()).unwrap());
    let settings = EncoderSettings::new(8, GeometrySource::Sent).with_budget(budget);
    Encoder::new(layout, vec![Arc::new(geometry)], settings).unwrap()
}

/// Sets every point as a shadow passes over them, which returns after ten frames, and finishes the frame.
fn frame(encoder: &mut Encoder, number: u32, coder: BlockCoder) -> EncodedFrame {
    for point in 0..POINTS {
        let distance = (point % 200).abs_diff(number % 10 * 20).min(60) as u8;
        encoder.set_ao(point, 60 + 3 * distance).unwrap();
    }
    let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
    let time = StreamTime(u64::from(number) * 16_667);
    let meta = FrameMeta { kind, frame: FrameIndex(number), time, changed_points: 0 };
    encoder.finish(meta, coder).unwrap()
}

#[test]
fn frames_of_changes_take_no_memory_but_for_what_they_return() {
    let limits = Limits::default();
    let budgets = [None, Some(Budget::new(150).with_longest_age(9))];
    for (coder, budget) in CODERS.into_iter().flat_map(|coder| budgets.map(|budget| (coder, budget))) {
        let mut encoder = encoder(budget);
        let mut state = State::new(Arc::clone(encoder.state().layout()));
        let mut decoder = Decoder::new();
        let mut waited = 0;
        for number in 0..40 {
            let mut made = None;
            let encoded = allocation_counter::measure(|| made = Some(frame(&mut encoder, number, coder)));
            let EncodedFrame { body, info } = made.unwrap();
            let mut found = None;
            let applied =
                allocation_counter::measure(|| found = Some(decoder.decode(&mut state, &body, &limits)));
            assert_eq!(found, Some(Ok(info.clone())));
            assert_eq!(state.hash(), encoder.state().hash());
            if number < 20 {
                continue;
            }
            let waits = encoder.postponed().map_or(0, |postponed| postponed.points);
            assert!(info.sections[0].records + waits > 100, "frame {number} is no test: {info:?}");
            waited += waits;
            // The body and its section table; the section table.
            assert_eq!(encoded.count_total, 2, "{coder:?}, frame {number}: {encoded:?}");
            assert_eq!(applied.count_total, 1, "{coder:?}, frame {number}: {applied:?}");
        }
        assert_eq!(budget.is_some(), waited > 1000, "{coder:?}: {waited}");
    }
}
