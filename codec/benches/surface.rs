//! Measures the parts of a stream of profile `surface`. Each bench checks its result before it is timed.

mod scene;
#[path = "scene/surface.rs"]
mod stream;

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, SectionTag, StreamTime};
use psao_codec::surface::{Decoder, State, keyframe};

use stream::{CODERS, Stream};

type Failure = Box<dyn std::error::Error>;

/// Number of frames that are applied in a row.
const RUN: u32 = 20;

/// Measures geometry and values: the first frame.
fn keyframes(bench: &mut Criterion, stream: &Stream) -> Result<(), Failure> {
    let mut group = bench.benchmark_group("surface, keyframe");
    let limits = Limits::default();
    let points = stream.layout.points();
    for (name, coder) in CODERS {
        let mut encoder = stream.encoder()?;
        let frame = stream.frame(&mut encoder, 0, coder)?;
        let empty = State::new(Arc::clone(&stream.layout));
        let mut state = empty.clone();
        let mut decoder = Decoder::new();
        decoder.decode(&mut state, &frame.body, &limits)?;
        assert!(&state == encoder.state() && state.hash() == state.full_hash(), "{name}");
        let bytes = |tag| {
            let sections = frame.info.sections.iter().filter(|section| section.tag == tag);
            sections.map(|section| section.wire_bytes).sum::<u32>()
        };
        let (geometry, values) = (bytes(SectionTag::GEOMETRY), bytes(SectionTag::VALUES));
        eprintln!("{name}: {points} points, geometry {geometry} B, values {values} B");
        group.throughput(Throughput::Elements(points.into()));
        let meta = FrameMeta {
            kind: FrameKind::Key,
            frame: FrameIndex(0),
            time: StreamTime(0),
            changed_points: points,
        };
        group.bench_function(format!("{name}, write"), |bench| {
            bench.iter(|| keyframe(black_box(&state), meta, coder, &[]));
        });
        group.bench_function(format!("{name}, apply"), |bench| {
            let run = |mut state: State| {
                let applied = decoder.decode(&mut state, &frame.body, &limits);
                (state, applied)
            };
            bench.iter_batched(|| empty.clone(), run, BatchSize::LargeInput);
        });
    }
    let encoder = &mut stream.encoder()?;
    stream.frame(encoder, 0, BlockCoder::Stored)?;
    group.bench_function("hash of the whole state", |bench| {
        bench.iter(|| black_box(encoder.state()).full_hash());
    });
    group.finish();
    Ok(())
}

/// Measures changes.
fn deltas(bench: &mut Criterion, stream: &Stream) -> Result<(), Failure> {
    let mut group = bench.benchmark_group("surface, delta");
    let limits = Limits::default();
    for (name, coder) in CODERS {
        let mut encoder = stream.encoder()?;
        stream.frame(&mut encoder, 0, BlockCoder::Stored)?;
        let client = encoder.state().clone();
        let mut state = client.clone();
        let mut decoder = Decoder::new();
        let (mut bodies, mut changed, mut bytes) = (Vec::new(), 0, 0);
        for number in 1..=RUN {
            let frame = stream.frame(&mut encoder, number, coder)?;
            decoder.decode(&mut state, &frame.body, &limits)?;
            assert!(&state == encoder.state(), "{name}, frame {number}");
            // The first frames after the keyframe may have no changes, as little has moved yet.
            let section = frame.info.section(SectionTag::CHANGES);
            changed += section.map_or(0, |section| section.records);
            bytes += section.map_or(0, |section| section.wire_bytes);
            bodies.push(frame.body);
        }
        eprintln!("{name}: {} changed points a frame, {} B", changed / RUN, bytes / RUN);
        group.throughput(Throughput::Elements((changed / RUN).into()));
        let mut number = RUN;
        group.bench_function(format!("{name}, offer all and write a frame"), |bench| {
            bench.iter(|| {
                number += 1;
                stream.frame(&mut encoder, number, coder).map(|frame| frame.body.len()).unwrap_or_default()
            });
        });
        group.throughput(Throughput::Elements(changed.into()));
        group.bench_function(format!("{name}, apply {RUN} frames"), |bench| {
            let run = |mut state: State| {
                let done = bodies.iter().all(|body| decoder.decode(&mut state, body, &limits).is_ok());
                (state, done)
            };
            bench.iter_batched(|| client.clone(), run, BatchSize::LargeInput);
        });
    }
    group.finish();
    Ok(())
}

fn all(bench: &mut Criterion) {
    let done = Stream::new().and_then(|stream| {
        keyframes(bench, &stream)?;
        deltas(bench, &stream)
    });
    assert!(done.is_ok(), "{done:?}");
}

fn quick() -> Criterion {
    let short = std::time::Duration::from_secs(1);
    Criterion::default().sample_size(10).warm_up_time(short / 5).measurement_time(short)
}

criterion_group! { name = benches; config = quick(); targets = all }
criterion_main!(benches);
