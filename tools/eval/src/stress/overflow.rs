//! Tables that are too small. Points that do not fit must be counted exactly (paper, section 3.2).

use std::sync::Arc;

use psao_codec::Limits;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::{
    self, Grid, InstanceLayout, Layout, Occupancy, PointFormat, PointSample, State, apply,
};

use super::{Case, StressError};

/// Number of points put into each table.
const POINTS: u32 = 400;

pub(super) fn cases() -> Vec<Case> {
    let exact = |name, what, measure| Case {
        name,
        what,
        bound_text: "exact: stored points plus points counted as overflow equal the points put, and clients hold the stored points",
        bound: 0.0,
        documented: None,
        unit: "points",
        measure,
    };
    vec![
        exact(
            "overflow-cell",
            "Points unaccounted for when 400 points crowd into one cell of seven, and half of them leave again.",
            || unaccounted([1, 1, 1], 1, 64, |counts| counts.cell_full),
        ),
        exact(
            "overflow-bucket",
            "Points unaccounted for when 400 points in 64 cells share one bucket of eight entries, and half of them leave again.",
            || unaccounted([4, 4, 4], 1, 64, |counts| counts.bucket_full),
        ),
        exact(
            "overflow-cells",
            "Points unaccounted for when 400 points in 64 cells find only five cells in the whole state, and half of them leave again.",
            || unaccounted([4, 4, 4], 64, 5, |counts| counts.no_cell),
        ),
    ]
}

/// Fills a table, then takes every other point out. Returns the number of points that are unaccounted for, or all
/// points if the table did not overflow for the expected `reason`.
fn unaccounted(
    dims: [u32; 3],
    bucket_count: u32,
    cell_capacity: u32,
    reason: fn(&Occupancy) -> u32,
) -> Result<f64, StressError> {
    let grid = Grid::new([0.0; 3], 1.0, dims).map_err(StressError::new)?;
    let instance = InstanceLayout { grid, first_bucket: 0, bucket_count, kernel_radius: 0.5 };
    let limits = Limits::default();
    let layout = Arc::new(
        Layout::new(PointFormat::Bits32, vec![instance], cell_capacity, &limits).map_err(StressError::new)?,
    );
    let mut encoder = paper::Encoder::new(Arc::clone(&layout), &[POINTS]).map_err(StressError::new)?;
    let mut client = State::new(layout);
    for point in 0..POINTS {
        encoder.put(point, &sample(point, dims)).map_err(StressError::new)?;
    }
    let mut worst = settle(&mut encoder, &mut client, 0, POINTS)?;
    if reason(&encoder.counts()) == 0 {
        return Ok(f64::from(POINTS));
    }
    for point in (0..POINTS).step_by(2) {
        encoder.remove(point).map_err(StressError::new)?;
    }
    encoder.retry_unplaced();
    worst = worst.max(settle(&mut encoder, &mut client, 1, POINTS / 2)?);
    Ok(f64::from(worst))
}

/// Sends a frame. Returns the number of `put` points that the counts or the client's cells do not account for.
fn settle(
    encoder: &mut paper::Encoder,
    client: &mut State,
    frame: u32,
    put: u32,
) -> Result<u32, StressError> {
    let kind = if frame == 0 { FrameKind::Key } else { FrameKind::Delta };
    let meta =
        FrameMeta { kind, frame: FrameIndex(frame), time: StreamTime(u64::from(frame)), changed_points: put };
    let encoded = encoder.finish(meta, BlockCoder::Stored).map_err(StressError::new)?;
    apply(client, &encoded.body, &Limits::default()).map_err(StressError::new)?;
    let counts = encoder.counts();
    let entries = client.buckets().iter().flat_map(paper::Bucket::entries);
    let cells = entries.filter(|entry| entry.is_used()).map(|entry| entry.cell() as usize);
    let held: usize = cells.map(|cell| client.cells()[cell].points(client.layout().format()).count()).sum();
    let held = u32::try_from(held).unwrap_or(u32::MAX);
    Ok(put.abs_diff(counts.points_stored + counts.unplaced()).max(held.abs_diff(counts.points_stored)))
}

/// Returns point number `point`; consecutive points go through the grid cell by cell.
fn sample(point: u32, dims: [u32; 3]) -> PointSample {
    let cell = [point % dims[0], point / dims[0] % dims[1], point / (dims[0] * dims[1]) % dims[2]];
    PointSample {
        local: cell.map(|axis| axis as f32 + 0.5),
        normal: [0.0, 1.0, 0.0],
        ao: (point % 256) as u8,
    }
}
