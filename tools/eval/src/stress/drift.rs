//! A value that drifts by less than the threshold a frame. The client must still follow (bounded error).

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::ResendAo;
use psao_codec::paper::{self, Grid, InstanceLayout, Layout, PointFormat, PointSample, State, apply};
use psao_codec::quant::unorm;

use super::{Case, StressError};

/// Number of frames of the drift.
const FRAMES: u32 = 10_000;
/// The paper's threshold, in steps of 1/255.
const THRESHOLD: u8 = 8;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, what, measure| Case {
        name,
        what,
        bound_text: "threshold and half a quantisation step of the server's byte: 8.5/255, at every frame",
        bound: f64::from(THRESHOLD) + 0.5,
        documented: None,
        unit: "steps of 1/255",
        measure,
    };
    vec![
        case(
            "slow-drift",
            "Largest difference between a point's AO and the client's over 10,000 frames in which it changes by far less than the threshold a frame.",
            || worst_difference(PointFormat::Bits32),
        ),
        case("slow-drift-24", "The same with 24-bit points, whose AO has 6 bits.", || {
            worst_difference(PointFormat::Bits24)
        }),
        case("slow-drift-16", "The same with 16-bit points, whose AO has 5 bits.", || {
            worst_difference(PointFormat::Bits16)
        }),
    ]
}

/// Returns the AO at a frame: two slow waves over the whole range, of at most a tenth of a step a frame.
fn drift(frame: u32) -> f64 {
    let t = f64::from(frame);
    0.5 + 0.35 * libm::sin(t / 1_300.0) + 0.15 * libm::cos(t / 470.0)
}

/// Sends the drifting point through encoder, frame and client, when the server's own rule says so.
fn worst_difference(format: PointFormat) -> Result<f64, StressError> {
    let grid = Grid::new([0.0; 3], 1.0, [1; 3]).map_err(StressError::new)?;
    let instance = InstanceLayout { grid, first_bucket: 0, bucket_count: 1, kernel_radius: 0.5 };
    let limits = Limits::default();
    let layout = Arc::new(Layout::new(format, vec![instance], 1, &limits).map_err(StressError::new)?);
    let mut encoder = paper::Encoder::new(Arc::clone(&layout), &[1]).map_err(StressError::new)?;
    let mut client = State::new(layout);
    let rule = ResendAo { threshold: THRESHOLD, format };
    let mut sent = None;
    let mut worst = 0.0_f64;
    for frame in 0..FRAMES {
        let ao = drift(frame);
        let byte = unorm::quantise(ao as f32);
        let resend = sent.is_none_or(|sent| rule.is_due(byte, sent));
        if resend {
            let sample = PointSample { local: [0.5; 3], normal: [0.0, 1.0, 0.0], ao: byte };
            encoder.put(0, &sample).map_err(StressError::new)?;
            sent = Some(format.held_ao(byte));
        }
        let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
        let meta = FrameMeta {
            kind,
            frame: FrameIndex(frame),
            time: StreamTime(u64::from(frame)),
            changed_points: u32::from(resend),
        };
        let encoded = encoder.finish(meta, BlockCoder::Stored).map_err(StressError::new)?;
        apply(&mut client, &encoded.body, &limits).map_err(StressError::new)?;
        let held = client.lookup(0, [0; 3]).and_then(|cell| cell.points(format).next());
        let held = held.map_or(f64::INFINITY, |point| f64::from(point.ao));
        worst = worst.max((ao * 255.0 - held).abs());
    }
    Ok(worst)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drift_is_slow_and_stays_in_range() {
        let values: Vec<f64> = (0..FRAMES).map(drift).collect();
        assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        let fastest = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(fastest * 255.0 < 0.2, "{fastest}");
        let [low, high] =
            [f64::min as fn(f64, f64) -> f64, f64::max].map(|f| values.iter().copied().reduce(f));
        assert!(high.unwrap() - low.unwrap() > 0.8, "{low:?} {high:?}");
    }

    #[test]
    fn the_client_lags_but_never_by_more_than_the_bound() {
        for format in PointFormat::ALL {
            let worst = worst_difference(format).unwrap();
            assert!(worst > 6.0 && worst < f64::from(THRESHOLD) + 0.5, "{format:?}: {worst}");
        }
    }
}
