//! Measures the block coders on the records that the paper sends. Each bench checks its result before it is timed.

#[path = "scene/paper.rs"]
mod paper;
mod scene;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use psao_codec::block::{BlockCoder, Compressor, Decompressor};

use paper::{Paper, cell_records};

fn blocks(bench: &mut Criterion) -> Result<(), Box<dyn std::error::Error>> {
    let mut stream = Paper::new()?;
    for number in 0..10 {
        stream.frame(number, BlockCoder::Stored)?;
    }
    let (frame, points) = stream.frame(10, BlockCoder::Stored)?;
    let raw = cell_records(&frame);
    let size = raw.len() as u32;
    let mut group = bench.benchmark_group("blocks");
    group.throughput(Throughput::Bytes(size.into()));
    let coders = [
        ("stored", BlockCoder::Stored),
        ("lz4", BlockCoder::Lz4),
        ("zstd 1", BlockCoder::Zstd { level: 1 }),
        ("zstd 15", BlockCoder::Zstd { level: 15 }),
    ];
    for (name, coder) in coders {
        let (mut compressor, mut decompressor) = (Compressor::new(), Decompressor::new());
        let (mut stored, mut back) = (Vec::new(), Vec::new());
        let id = compressor.compress(raw, coder, &mut stored)?;
        decompressor.decompress(&stored, id, size, size, &mut back)?;
        assert!(back == raw && stored.len() <= raw.len(), "{name}");
        eprintln!("{name}: {size} B of cells, {points} changed points, become {} B", stored.len());
        group.bench_function(format!("{name}, compress"), |bench| {
            let mut out = Vec::new();
            bench.iter(|| {
                out.clear();
                compressor.compress(raw, coder, &mut out)
            });
        });
        group.bench_function(format!("{name}, decompress"), |bench| {
            bench.iter(|| decompressor.decompress(&stored, id, size, size, &mut back));
        });
    }
    group.finish();
    Ok(())
}

fn all(bench: &mut Criterion) {
    let done = blocks(bench);
    assert!(done.is_ok(), "{done:?}");
}

fn quick() -> Criterion {
    let short = std::time::Duration::from_secs(1);
    Criterion::default().sample_size(10).warm_up_time(short / 5).measurement_time(short)
}

criterion_group! { name = benches; config = quick(); targets = all }
criterion_main!(benches);
