//! What the parts of a frame cost. Each bench checks its answer before it is timed.
//!
//! The scene: 64 floor tiles of 1 m^2 with 1,024 points each, cells of 0.1 m, every point's AO moving a
//! little from frame to frame.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use psao_codec::Limits;
use psao_codec::block::{BlockCoder, Compressor, Decompressor};
use psao_codec::cells::{Grid, InstanceLayout, Layout, PaperEncoder, PointSample, bucket_count};
use psao_codec::frame::{
    Applier, EncodedFrame, FrameIndex, FrameKind, FrameMeta, SectionTag, State, StreamTime,
};
use psao_codec::point::Packed32;
use psao_codec::quant::oct;

const TILES: u32 = 64;
const POINTS: u32 = 1024;

type Failure = Box<dyn std::error::Error>;

fn layout() -> Result<Arc<Layout>, Failure> {
    let grid = Grid::new([0.0, -0.05, 0.0], 0.1, [10, 2, 10])?;
    let count = bucket_count(1.0, 0.1, 4.0);
    let tile =
        |at| InstanceLayout { grid, first_bucket: at * count, bucket_count: count, kernel_radius: 0.05 };
    Ok(Arc::new(Layout::new((0..TILES).map(tile).collect(), 1 << 15, &Limits::default())?))
}

/// Point `at` in frame `frame`; the position stays, the AO moves.
fn sample(at: u32, frame: u32) -> PointSample {
    let noise = at.wrapping_mul(0x9E37_79B9) ^ (at >> 7).wrapping_mul(0x85EB_CA6B);
    let along = |shift: u32| ((noise >> shift) & 1023) as f32 / 1024.0;
    let ao = (noise >> 3) as u8 / 2 + (frame.wrapping_mul(7).wrapping_add(noise >> 9) % 5) as u8;
    PointSample { local: [along(0), 0.0, along(12)], normal: [along(4) - 0.5, 1.0, along(8) - 0.5], ao }
}

fn put_all(encoder: &mut PaperEncoder, frame: u32) -> Result<(), Failure> {
    for at in 0..TILES * POINTS {
        encoder.put(at, &sample(at, frame))?;
    }
    Ok(())
}

fn finish(
    encoder: &mut PaperEncoder,
    kind: FrameKind,
    frame: u32,
    coder: BlockCoder,
) -> Result<EncodedFrame, Failure> {
    let time = StreamTime(u64::from(frame) * 16_667);
    let meta = FrameMeta { kind, frame: FrameIndex(frame), time, changed_points: TILES * POINTS };
    Ok(encoder.finish(meta, coder)?)
}

/// An encoder and a client after the keyframe, and the delta that follows, its blocks stored.
struct Story {
    client: State,
    delta: EncodedFrame,
    after: State,
}

fn story(coder: BlockCoder) -> Result<Story, Failure> {
    let mut encoder = PaperEncoder::new(layout()?, &[POINTS; TILES as usize])?;
    put_all(&mut encoder, 0)?;
    finish(&mut encoder, FrameKind::Key, 0, coder)?;
    let client = encoder.state().clone();
    put_all(&mut encoder, 1)?;
    let delta = finish(&mut encoder, FrameKind::Delta, 1, coder)?;
    Ok(Story { client, delta, after: encoder.state().clone() })
}

/// The raw cell records of the delta.
fn cell_records(story: &Story) -> Vec<u8> {
    let info = &story.delta.info;
    let cells = info.section(SectionTag::CELLS).map_or(0, |section| section.wire_bytes as usize);
    let body = &story.delta.body;
    body[body.len() - cells..].to_vec()
}

fn points(bench: &mut Criterion) {
    let normals: Vec<[f32; 3]> = (0..1024).map(|at| sample(at, 0).normal).collect();
    let mut group = bench.benchmark_group("points");
    group.throughput(Throughput::Elements(1024));
    assert!(normals.iter().all(|normal| oct::decode(oct::encode(*normal))[1] > 0.5));
    group.bench_function("oct best of four", |bench| {
        bench.iter(|| normals.iter().map(|normal| u32::from(oct::encode(black_box(*normal)))).sum::<u32>());
    });
    group.bench_function("oct plain", |bench| {
        bench.iter(|| {
            normals.iter().map(|normal| u32::from(oct::encode_plain(black_box(*normal)))).sum::<u32>()
        });
    });
    assert_eq!(Packed32::pack([1.0; 3], normals[5], 9).position_codes(), [31; 3]);
    group.bench_function("pack", |bench| {
        let pack = |normal: &[f32; 3]| Packed32::pack(black_box([0.3, 0.6, 0.9]), *normal, 77).to_bits();
        bench.iter(|| normals.iter().map(pack).fold(0, |sum, bits| sum ^ bits));
    });
    group.finish();
}

fn encoder(bench: &mut Criterion) -> Result<(), Failure> {
    let mut encoder = PaperEncoder::new(layout()?, &[POINTS; TILES as usize])?;
    put_all(&mut encoder, 0)?;
    finish(&mut encoder, FrameKind::Key, 0, BlockCoder::Stored)?;
    assert!(encoder.counts().points_stored > TILES * POINTS / 3, "{:?}", encoder.counts());
    assert_eq!(encoder.state().hash(), encoder.state().full_hash());
    let mut group = bench.benchmark_group("encoder");
    group.sample_size(20);
    group.throughput(Throughput::Elements(u64::from(TILES * POINTS)));
    let mut frame = 0;
    group.bench_function("put every point", |bench| {
        bench.iter(|| {
            frame += 1;
            put_all(&mut encoder, frame)
        });
    });
    group.bench_function("put every point, finish (compaction, exclusive or, hash), stored", |bench| {
        bench.iter(|| {
            frame += 1;
            put_all(&mut encoder, frame)?;
            finish(&mut encoder, FrameKind::Delta, frame, BlockCoder::Stored)
        });
    });
    let state = encoder.state();
    group.bench_function("full hash", |bench| bench.iter(|| black_box(state).full_hash()));
    group.finish();
    Ok(())
}

fn blocks(bench: &mut Criterion) -> Result<(), Failure> {
    let raw = cell_records(&story(BlockCoder::Stored)?);
    let size = raw.len() as u32;
    let mut group = bench.benchmark_group("blocks");
    group.sample_size(10);
    group.throughput(Throughput::Bytes(u64::from(size)));
    let coders = [("lz4", BlockCoder::Lz4), ("zstd 15 lazy", BlockCoder::default())];
    for (name, coder) in coders {
        let (mut compressor, mut decompressor) = (Compressor::new(), Decompressor::new());
        let (mut stored, mut back) = (Vec::new(), Vec::new());
        let id = compressor.compress(&raw, coder, &mut stored)?;
        decompressor.decompress(&stored, id, size, size, &mut back)?;
        assert!(back == raw && stored.len() < raw.len(), "{name}");
        println!("{name}: {size} B of cell records become {} B", stored.len());
        group.bench_function(format!("{name} compress"), |bench| {
            let mut out = Vec::new();
            bench.iter(|| {
                out.clear();
                compressor.compress(&raw, coder, &mut out)
            });
        });
        group.bench_function(format!("{name} decompress"), |bench| {
            bench.iter(|| decompressor.decompress(&stored, id, size, size, &mut back));
        });
    }
    group.finish();
    Ok(())
}

fn apply(bench: &mut Criterion) -> Result<(), Failure> {
    let mut group = bench.benchmark_group("apply");
    group.sample_size(20);
    let limits = Limits::default();
    for (name, coder) in
        [("stored", BlockCoder::Stored), ("lz4", BlockCoder::Lz4), ("zstd", BlockCoder::default())]
    {
        let Story { client, delta, after } = story(coder)?;
        let mut applier = Applier::new();
        let mut state = client.clone();
        applier.apply(&mut state, &delta.body, &limits)?;
        assert!(state == after && state.hash() == state.full_hash(), "{name}");
        let raw: u64 = delta.info.sections.iter().map(|section| u64::from(section.raw_bytes)).sum();
        group.throughput(Throughput::Bytes(raw));
        group.bench_function(format!("delta, {name}"), |bench| {
            let run = |mut state: State| {
                let applied = applier.apply(&mut state, &delta.body, &limits);
                (state, applied)
            };
            bench.iter_batched(|| client.clone(), run, BatchSize::LargeInput);
        });
    }
    group.finish();
    Ok(())
}

fn all(bench: &mut Criterion) {
    points(bench);
    for part in [encoder, blocks, apply] {
        let done = part(bench);
        assert!(done.is_ok(), "{done:?}");
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
