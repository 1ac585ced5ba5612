//! Measures packing of points. Each bench checks its result before it is timed.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use psao_codec::paper::PointFormat;
use psao_codec::quant::oct;

const COUNT: u32 = 1024;

/// Returns a direction in the upper half, and a place in a cell.
fn sample(at: u32) -> ([f32; 3], [f32; 3]) {
    let noise = at.wrapping_mul(0x9E37_79B9) ^ (at >> 7).wrapping_mul(0x85EB_CA6B);
    let along = |shift: u32| ((noise >> shift) & 1023) as f32 / 1024.0;
    ([along(4) - 0.5, 1.0, along(8) - 0.5], [along(0), along(6), along(12)])
}

fn normals(bench: &mut Criterion) {
    let normals: Vec<[f32; 3]> = (0..COUNT).map(|at| sample(at).0).collect();
    let mut group = bench.benchmark_group("normals");
    group.throughput(Throughput::Elements(COUNT.into()));
    for bits in [2, 3, 4, 6] {
        let limit = oct::max_error_degrees(bits) + 0.05;
        for normal in &normals {
            let found = oct::decode_bits(bits, oct::encode_bits(bits, *normal));
            let length = normal.iter().map(|axis| axis * axis).sum::<f32>().sqrt();
            let cosine = (0..3).map(|axis| found[axis] * normal[axis]).sum::<f32>() / length;
            assert!(cosine.clamp(-1.0, 1.0).acos().to_degrees() <= limit, "{normal:?} {found:?}");
        }
        group.bench_function(format!("octahedral, {bits} bits an axis, encode"), |bench| {
            let encode = |normal: &[f32; 3]| u32::from(oct::encode_bits(bits, black_box(*normal)));
            bench.iter(|| normals.iter().map(encode).sum::<u32>());
        });
        let codes: Vec<u16> = normals.iter().map(|normal| oct::encode_bits(bits, *normal)).collect();
        group.bench_function(format!("octahedral, {bits} bits an axis, decode"), |bench| {
            bench.iter(|| codes.iter().map(|code| oct::decode_bits(bits, black_box(*code))[1]).sum::<f32>());
        });
    }
    group.bench_function("octahedral, 4 bits an axis, encode by rounding", |bench| {
        let encode = |normal: &[f32; 3]| u32::from(oct::encode_plain(black_box(*normal)));
        bench.iter(|| normals.iter().map(encode).sum::<u32>());
    });
    group.finish();
}

fn packing(bench: &mut Criterion) {
    let mut group = bench.benchmark_group("packing");
    group.throughput(Throughput::Elements(COUNT.into()));
    let samples: Vec<_> = (0..COUNT).map(sample).collect();
    for format in [PointFormat::Bits32, PointFormat::Bits24, PointFormat::Bits16] {
        let pack = |(normal, frac): &([f32; 3], [f32; 3])| format.pack(black_box(*frac), *normal, 77);
        let words: Vec<u32> = samples.iter().map(pack).collect();
        for (word, (_, frac)) in words.iter().zip(&samples) {
            let found = format.unpack(*word);
            let off = (0..3).map(|axis| (found.frac[axis] - frac[axis]).abs()).fold(0.0, f32::max);
            assert!(off <= format.max_position_error() + 1e-6 && found.ao.abs_diff(77) <= 4);
        }
        group.bench_function(format!("{} bits, pack", format.bits()), |bench| {
            bench.iter(|| samples.iter().map(pack).fold(0, |sum, word| sum ^ word));
        });
        group.bench_function(format!("{} bits, unpack", format.bits()), |bench| {
            bench
                .iter(|| words.iter().map(|word| u32::from(format.unpack(black_box(*word)).ao)).sum::<u32>());
        });
    }
    group.finish();
}

fn quick() -> Criterion {
    let short = std::time::Duration::from_millis(300);
    Criterion::default().sample_size(10).warm_up_time(short / 3).measurement_time(short)
}

criterion_group! { name = benches; config = quick(); targets = normals, packing }
criterion_main!(benches);
