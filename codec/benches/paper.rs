//! Measures the parts of a frame of profile `paper`. Each bench checks its result before it is timed.

#[path = "scene/paper.rs"]
mod paper;
mod scene;

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::paper::{Decoder, State};

use paper::{Paper, cell_records};

type Failure = Box<dyn std::error::Error>;

fn encoder(bench: &mut Criterion) -> Result<(), Failure> {
    let mut stream = Paper::new()?;
    for number in 0..10 {
        stream.frame(number, BlockCoder::Stored)?;
    }
    let counts = stream.encoder.counts();
    assert!(counts.points_stored > 80_000, "{counts:?}");
    assert_eq!(stream.encoder.state().hash(), stream.encoder.state().full_hash());
    let mut group = bench.benchmark_group("paper");
    let (frame, changed) = stream.frame(10, BlockCoder::Stored)?;
    assert!(changed > 500 && !cell_records(&frame).is_empty());
    group.throughput(Throughput::Elements(changed.into()));
    let mut number = 10;
    group.bench_function("a frame: changed points put, exclusive or, hash; stored", |bench| {
        bench.iter(|| {
            number += 1;
            stream.frame(number, BlockCoder::Stored).map(|frame| frame.1).unwrap_or_default()
        });
    });
    let points = stream.frames[0].len() as u32;
    let taken = points / 50;
    group.throughput(Throughput::Elements(taken.into()));
    // Removed and put again: every slot is freed, its cell compacted, and the slot taken again.
    let stored = stream.encoder.counts().points_stored;
    group.bench_function(
        "compaction: 2 % of the points removed, put again, unplaced ones retried",
        |bench| {
            bench.iter(|| {
                for at in 0..taken {
                    let point = at * 50;
                    if stream.encoder.remove(point).is_ok() {
                        let sample = stream.samples[point as usize];
                        black_box(stream.encoder.put(point, &sample).is_ok());
                    }
                }
                stream.encoder.retry_unplaced();
            });
        },
    );
    let now = stream.encoder.counts().points_stored;
    assert!(now * 100 >= stored * 99, "{now} of {stored} points are stored");
    group.throughput(Throughput::Elements(points.into()));
    let state = stream.encoder.state();
    group.bench_function("hash of the whole state", |bench| bench.iter(|| black_box(state).full_hash()));
    group.finish();
    Ok(())
}

fn apply(bench: &mut Criterion) -> Result<(), Failure> {
    let mut group = bench.benchmark_group("paper, apply");
    let limits = Limits::default();
    let coders =
        [("stored", BlockCoder::Stored), ("lz4", BlockCoder::Lz4), ("zstd 15", BlockCoder::default())];
    for (name, coder) in coders {
        let mut stream = Paper::new()?;
        for number in 0..10 {
            stream.frame(number, BlockCoder::Stored)?;
        }
        let client: State = stream.encoder.state().clone();
        let (delta, changed) = stream.frame(10, coder)?;
        let mut decoder = Decoder::new();
        let mut state = client.clone();
        decoder.decode(&mut state, &delta.body, &limits)?;
        assert!(&state == stream.encoder.state() && state.hash() == state.full_hash(), "{name}");
        group.throughput(Throughput::Elements(changed.into()));
        group.bench_function(name, |bench| {
            let run = |mut state: State| {
                let applied = decoder.decode(&mut state, &delta.body, &limits);
                (state, applied)
            };
            bench.iter_batched(|| client.clone(), run, BatchSize::LargeInput);
        });
    }
    group.finish();
    Ok(())
}

fn all(bench: &mut Criterion) {
    for part in [encoder, apply] {
        let done = part(bench);
        assert!(done.is_ok(), "{done:?}");
    }
}

fn quick() -> Criterion {
    let short = std::time::Duration::from_secs(1);
    Criterion::default().sample_size(10).warm_up_time(short / 5).measurement_time(short)
}

criterion_group! { name = benches; config = quick(); targets = all }
criterion_main!(benches);
