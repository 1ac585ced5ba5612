//! Measures bytes and time a frame for the same AO changes: by the paper's method, by other coders and by profile
//! `surface`. Each bench checks its result before it is timed. The table of bytes comes first.
//!
//! The bytes are only those of the changes, without headers: cell records for the paper, CHANGES for `surface`.

#[path = "scene/paper.rs"]
mod paper;
mod scene;
#[path = "scene/surface.rs"]
mod stream;

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use pco::{ChunkConfig, standalone};
use psao_codec::block::{BlockCoder, Compressor, Decompressor};
use psao_codec::envelope::SectionTag;
use zstd_safe::{CCtx, CParameter, DCtx, InBuffer, OutBuffer, Strategy};

use paper::{Paper, cell_records};
use scene::{PERIOD, THRESHOLD};
use stream::{CODERS, Stream};

type Failure = Box<dyn std::error::Error>;

/// Returns the cell records of each frame of a period after the keyframe, and the mean number of changed points.
fn records() -> Result<(Vec<Vec<u8>>, u32), Failure> {
    let mut stream = Paper::new()?;
    stream.frame(0, BlockCoder::Stored)?;
    let (mut records, mut changed) = (Vec::new(), 0);
    for number in 1..=PERIOD {
        let (frame, points) = stream.frame(number, BlockCoder::Stored)?;
        records.push(cell_records(&frame).to_vec());
        changed += points;
    }
    let stored = stream.encoder.counts().points_stored;
    eprintln!("paper: {stored} of {} points have a slot", stream.frames[0].len());
    Ok((records, changed / PERIOD))
}

/// Prints a line of the table: mean, smallest and largest length of a frame.
fn line(name: &str, sizes: &[usize], changed: u32) {
    let mean = sizes.iter().sum::<usize>() as f64 / sizes.len() as f64;
    let (least, most) = (sizes.iter().min().copied(), sizes.iter().max().copied());
    let bits = mean * 8.0 / f64::from(changed);
    let (least, most) = (least.unwrap_or(0), most.unwrap_or(0));
    eprintln!("{name:<40} {mean:>9.0} B a frame ({least} to {most}), {bits:>6.2} bits a changed point");
}

/// One context for the whole stream, flushed after every frame.
struct Streaming {
    context: CCtx<'static>,
    room: Vec<u8>,
}

impl Streaming {
    fn new() -> Result<Streaming, Failure> {
        let mut context = CCtx::try_create().ok_or("no memory")?;
        for parameter in [CParameter::CompressionLevel(15), CParameter::Strategy(Strategy::ZSTD_lazy)] {
            context.set_parameter(parameter).map_err(zstd_safe::get_error_name)?;
        }
        Ok(Streaming { context, room: vec![0; 8 << 20] })
    }

    /// Returns what a frame adds to the stream.
    fn frame(&mut self, raw: &[u8]) -> Result<&[u8], Failure> {
        let mut input = InBuffer::around(raw);
        let mut output = OutBuffer::around(self.room.as_mut_slice());
        while input.pos() < raw.len() {
            self.context.compress_stream(&mut output, &mut input).map_err(zstd_safe::get_error_name)?;
        }
        while self.context.flush_stream(&mut output).map_err(zstd_safe::get_error_name)? > 0 {}
        let length = output.pos();
        Ok(&self.room[..length])
    }
}

fn cells(bench: &mut Criterion) -> Result<(), Failure> {
    let (records, changed) = records()?;
    line("paper, raw records", &records.iter().map(Vec::len).collect::<Vec<_>>(), changed);
    let mut group = bench.benchmark_group("cells");
    group.throughput(Throughput::Elements(changed.into()));
    for (name, coder) in [("lz4", BlockCoder::Lz4), ("zstd 15 lazy", BlockCoder::default())] {
        let (mut compressor, mut decompressor) = (Compressor::new(), Decompressor::new());
        let (mut sizes, mut back, mut out) = (Vec::new(), Vec::new(), Vec::new());
        for raw in &records {
            out.clear();
            let id = compressor.compress(raw, coder, &mut out)?;
            decompressor.decompress(&out, id, raw.len() as u32, raw.len() as u32, &mut back)?;
            assert!(&back == raw, "{name}");
            sizes.push(out.len());
        }
        line(&format!("paper, exclusive or + {name}"), &sizes, changed);
        let mut at = 0;
        group.bench_function(format!("exclusive or + {name}, a frame"), |bench| {
            bench.iter(|| {
                at = (at + 1) % records.len();
                out.clear();
                compressor.compress(&records[at], coder, &mut out)
            });
        });
    }
    let mut streaming = Streaming::new()?;
    let (mut sizes, mut whole) = (Vec::new(), Vec::new());
    for raw in &records {
        let added = streaming.frame(raw)?;
        sizes.push(added.len());
        whole.extend_from_slice(added);
    }
    assert!(unpacked(&whole, records.iter().map(Vec::len).sum())? == records.concat());
    line("paper, exclusive or + zstd 15 streaming", &sizes, changed);
    // A context that has seen the whole period would find every frame in its window: every pass has a new one.
    group.throughput(Throughput::Elements(u64::from(changed) * records.len() as u64));
    group.bench_function("exclusive or + zstd 15 lazy streaming, a whole period", |bench| {
        let pass = |mut streaming: Streaming| {
            records.iter().map(|raw| streaming.frame(raw).map(<[u8]>::len).unwrap_or_default()).sum::<usize>()
        };
        let fresh = || Streaming::new().ok();
        bench.iter_batched(fresh, |streaming| streaming.map(pass), BatchSize::PerIteration);
    });
    group.finish();
    Ok(())
}

/// Returns what the flushed beginning of a stream holds.
fn unpacked(stream: &[u8], length: usize) -> Result<Vec<u8>, Failure> {
    let mut context = DCtx::try_create().ok_or("no memory")?;
    let mut out = vec![0; length];
    let mut output = OutBuffer::around(out.as_mut_slice());
    let mut input = InBuffer::around(stream);
    while input.pos() < stream.len() && output.pos() < length {
        context.decompress_stream(&mut output, &mut input).map_err(zstd_safe::get_error_name)?;
    }
    Ok(out)
}

/// Measures `pco` on two columns of numbers: gaps between changed points, and differences of their AO.
fn columns(bench: &mut Criterion) -> Result<(), Failure> {
    let stream = Stream::new()?;
    let mut held = stream.frames[0].clone();
    let config = ChunkConfig::default();
    let (mut frames, mut sizes, mut changed) = (Vec::new(), Vec::new(), 0);
    for number in 1..=PERIOD {
        let now = &stream.frames[(number % PERIOD) as usize];
        let (mut gaps, mut steps, mut before) = (Vec::new(), Vec::new(), 0);
        for (at, (held, now)) in held.iter_mut().zip(now).enumerate() {
            if held.abs_diff(*now) >= THRESHOLD {
                gaps.push(at as u32 - before);
                steps.push(i16::from(*now) - i16::from(*held));
                (*held, before) = (*now, at as u32);
            }
        }
        let packed =
            [standalone::simple_compress(&gaps, &config)?, standalone::simple_compress(&steps, &config)?];
        assert!(standalone::simple_decompress::<u32>(&packed[0])? == gaps);
        assert!(standalone::simple_decompress::<i16>(&packed[1])? == steps);
        sizes.push(packed[0].len() + packed[1].len());
        changed += gaps.len() as u32;
        frames.push((gaps, steps));
    }
    line("pco, gaps and differences", &sizes, changed / PERIOD);
    let mut group = bench.benchmark_group("columns");
    group.throughput(Throughput::Elements((changed / PERIOD).into()));
    let mut at = 0;
    group.bench_function("pco, a frame", |bench| {
        bench.iter(|| {
            at = (at + 1) % frames.len();
            let (gaps, steps) = black_box(&frames[at]);
            [standalone::simple_compress(gaps, &config), standalone::simple_compress(steps, &config)]
        });
    });
    group.finish();
    Ok(())
}

/// Measures the bytes of profile `surface`. The bench `surface` has its times.
fn surface(_: &mut Criterion) -> Result<(), Failure> {
    let stream = Stream::new()?;
    for (name, coder) in CODERS {
        let mut encoder = stream.encoder()?;
        stream.frame(&mut encoder, 0, BlockCoder::Stored)?;
        let (mut sizes, mut changed) = (Vec::new(), 0);
        for number in 1..=PERIOD {
            let frame = stream.frame(&mut encoder, number, coder)?;
            // The first frames after the keyframe may have no changes, as little has moved yet.
            let section = frame.info.section(SectionTag::CHANGES);
            sizes.push(section.map_or(0, |section| section.wire_bytes as usize));
            changed += section.map_or(0, |section| section.records);
        }
        line(&format!("surface, {name}"), &sizes, changed / PERIOD);
    }
    Ok(())
}

fn all(bench: &mut Criterion) {
    for part in [surface, cells, columns] {
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
