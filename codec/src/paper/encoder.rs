//! The encoder of profile `paper`: memory management and frame writer (paper, sections 3.2 to 3.4).

use std::collections::BTreeSet;
use std::sync::Arc;

use super::cells::{CellAddress, DirtySet, Tables};
use super::changes::{TableChanges, push_all_records};
use super::resend::{PointRef, Resend};
use super::{
    Layout, Occupancy, Placement, PointError, Pose, PoseError, PutOutcome, Records, ResendAo, State,
    bucket_of, cell_id, write_body,
};
use crate::block::{BlockCoder, Compressor};
use crate::envelope::{EncodeError, EncodedFrame, FrameKind, FrameMeta};
use crate::memory;

/// One point as the server traced it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointSample {
    /// Position, metres, instance-local.
    pub local: [f32; 3],
    /// Direction of the normal, instance-local; its length does not matter.
    pub normal: [f32; 3],
    /// Accessibility, 255 = open.
    pub ao: u8,
}

/// Status of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PointStatus {
    /// The point was never put, or was removed.
    Absent,
    /// The point is in a slot of this cell.
    Stored(u32),
    /// The point was put and found no slot; the reason is never [`Placement::Stored`].
    Unplaced(Placement),
}

/// A point as last put.
#[derive(Debug, Clone, Copy)]
struct PointRecord {
    status: PointStatus,
    coord: [u32; 3],
    word: u32,
    outside: bool,
}

const ABSENT_POINT: PointRecord =
    PointRecord { status: PointStatus::Absent, coord: [0; 3], word: 0, outside: false };

/// Keeps the points of a stream in cells and buckets, and writes what changed.
///
/// All calls are deterministic: the same calls in the same order give the same bytes. The cost of a delta grows with
/// the changes, that of a keyframe with the state.
#[derive(Debug)]
pub struct Encoder {
    layout: Arc<Layout>,
    /// First point id of each instance.
    first_points: Vec<u32>,
    points: Vec<PointRecord>,
    unplaced: BTreeSet<u32>,
    tables: Tables,
    poses: Vec<Pose>,
    dirty_poses: DirtySet,
    counts: Occupancy,
    sent: State,
    records: Records,
    compressor: Compressor,
    resend: Option<Resend>,
}

impl Encoder {
    /// Creates an encoder without points. `points` has the number of point ids of each instance. Ids run through all
    /// instances in order, from 0.
    ///
    /// # Errors
    /// [`PointError::Instances`] unless there is one count for each instance of the layout, and
    /// [`PointError::TooMany`] beyond 2^32 - 1 points.
    pub fn new(layout: Arc<Layout>, points: &[u32]) -> Result<Encoder, PointError> {
        let instances = layout.instances().len();
        if points.len() != instances {
            return Err(PointError::Instances { expected: instances, found: points.len() });
        }
        let total: u64 = points.iter().map(|count| u64::from(*count)).sum();
        if total > u64::from(u32::MAX) {
            return Err(PointError::TooMany { found: total });
        }
        let starts = points.iter().scan(0_u32, |next, count| {
            let first = *next;
            *next = first + count;
            Some(first)
        });
        Ok(Encoder {
            first_points: starts.collect(),
            points: vec![ABSENT_POINT; total as usize],
            unplaced: BTreeSet::new(),
            tables: Tables::new(layout.bucket_total(), layout.cell_capacity()),
            poses: vec![Pose::IDENTITY; instances],
            dirty_poses: DirtySet::new(instances),
            counts: Occupancy::default(),
            sent: State::new(Arc::clone(&layout)),
            records: Records::new(layout.format()),
            compressor: Compressor::new(),
            resend: None,
            layout,
        })
    }

    /// Lets the encoder decide which of the points given to [`Encoder::set_point`] are sent again ([`ResendAo`]). It
    /// sends a point if its AO differs from that of clients by `threshold` 255ths or more; `threshold` is at least 1.
    /// It also sends points of deforming instances whose place changed enough. `deforms` tells for every instance of
    /// the layout, in order, whether it deforms.
    #[must_use]
    pub fn with_threshold(self, threshold: u8, deforms: &[bool]) -> Encoder {
        let rule = ResendAo { threshold, format: self.layout.format() };
        let ends = self.first_points.iter().skip(1).copied().chain([self.points.len() as u32]);
        let counts = self.first_points.iter().zip(ends).map(|(first, end)| end - first);
        let deforms = deforms.iter().copied().chain(std::iter::repeat(false));
        let resend = Resend::new(rule, counts.zip(deforms));
        Encoder { resend: Some(resend), ..self }
    }

    /// Sets a point, once a frame at most. Returns whether the next frame sends it. Without a threshold the result is
    /// always true, and this is [`Encoder::put`]. With one, the frame sends points that were never sent or differ
    /// enough from the clients' values.
    ///
    /// # Errors
    /// Those of [`Encoder::put`].
    pub fn set_point(&mut self, point: u32, sample: &PointSample) -> Result<bool, PointError> {
        self.record(point)?;
        let named = self.point_ref(point);
        let grid = &self.layout.instances()[named.instance].grid;
        let Some(resend) = &mut self.resend else {
            return self.put(point, sample).map(|_| true);
        };
        let due = resend.is_due(grid, named, sample);
        if due {
            check_sample(point, sample)?;
            resend.push(point, *sample);
        }
        Ok(due)
    }

    /// Returns the AO byte of a point as clients hold it. `None` if it was never sent, or without a threshold.
    #[must_use]
    pub fn sent_ao(&self, point: u32) -> Option<u8> {
        self.resend.as_ref()?.ao(point)
    }

    /// Returns position and normal of a point of a deforming instance as last sent, instance-local. `None` for other
    /// points.
    #[must_use]
    pub fn sent_place(&self, point: u32) -> Option<([f32; 3], [f32; 3])> {
        self.record(point).ok()?;
        let PointRef { instance, number, .. } = self.point_ref(point);
        self.resend.as_ref()?.place(instance, number)
    }

    /// Puts the points that the threshold lets through.
    fn put_due(&mut self) {
        let Some(due) = self.resend.as_mut().map(Resend::take_due) else { return };
        for (point, sample) in &due {
            self.put_checked(*point, sample);
            let named = self.point_ref(*point);
            if let Some(resend) = &mut self.resend {
                resend.record(named, sample);
            }
        }
        if let Some(resend) = &mut self.resend {
            resend.reuse(due);
        }
        self.retry_unplaced();
    }

    /// Returns the heap bytes in use for the stream: every point as last put, the tables of the server and of clients,
    /// and buffers kept between frames.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        let Self {
            first_points,
            points,
            unplaced,
            tables,
            poses,
            dirty_poses,
            sent,
            records,
            compressor,
            resend,
            ..
        } = self;
        let ours = memory::list(first_points)
            + memory::list(points)
            + memory::list(poses)
            + dirty_poses.heap_bytes();
        let unplaced = unplaced.len() * size_of::<u32>();
        let resend = resend.as_ref().map_or(0, Resend::heap_bytes);
        ours + resend
            + unplaced
            + tables.heap_bytes()
            + sent.heap_bytes()
            + records.heap_bytes()
            + compressor.heap_bytes()
    }

    /// Puts a point, moves it, or gives it new values. A point that finds no slot is kept and counted as unplaced.
    ///
    /// # Errors
    /// [`PointError::Unknown`], [`PointError::Position`] and [`PointError::Normal`]; nothing changes then.
    pub fn put(&mut self, point: u32, sample: &PointSample) -> Result<PutOutcome, PointError> {
        self.record(point)?;
        check_sample(point, sample)?;
        Ok(self.put_checked(point, sample))
    }

    /// Puts an existing point with a checked sample.
    fn put_checked(&mut self, point: u32, sample: &PointSample) -> PutOutcome {
        let PointRecord { status, coord, outside, .. } = self.points[point as usize];
        let instance = self.instance_of(point);
        let located = self.layout.instances()[instance].grid.locate(sample.local);
        let word = self.layout.format().pack(located.frac, sample.normal, sample.ao);
        self.counts.outside_grid -= u32::from(outside);
        self.counts.outside_grid += u32::from(located.outside);
        let record = &mut self.points[point as usize];
        record.coord = located.cell;
        record.word = word;
        record.outside = located.outside;
        let placement = match status {
            PointStatus::Stored(cell) if coord == located.cell => {
                self.tables.update(cell, point, word);
                Placement::Stored
            }
            _ => {
                self.take_out(point, status);
                self.place(point, instance)
            }
        };
        PutOutcome { placement, outside: located.outside }
    }

    /// Removes a point. It has no effect if the point was never put.
    ///
    /// # Errors
    /// [`PointError::Unknown`].
    pub fn remove(&mut self, point: u32) -> Result<(), PointError> {
        let PointRecord { status, outside, .. } = self.record(point)?;
        self.counts.outside_grid -= u32::from(outside);
        self.take_out(point, status);
        self.points[point as usize] = ABSENT_POINT;
        Ok(())
    }

    /// Sets the pose of an instance.
    ///
    /// # Errors
    /// [`PoseError`] for an instance outside the layout, or a pose that [`Pose::check`] refuses.
    pub fn set_pose(&mut self, instance: u32, pose: Pose) -> Result<(), PoseError> {
        let count = self.poses.len() as u32;
        let Some(place) = self.poses.get_mut(instance as usize) else {
            return Err(PoseError::Instance { instance, count });
        };
        pose.check(instance)?;
        *place = pose;
        self.dirty_poses.mark(instance);
        Ok(())
    }

    /// Tries to place all unplaced points, by ascending id. It returns at once if no slot became free since the last
    /// call.
    pub fn retry_unplaced(&mut self) {
        if !self.tables.take_freed() {
            return;
        }
        let unplaced: Vec<u32> = self.unplaced.iter().copied().collect();
        for point in unplaced {
            let instance = self.instance_of(point);
            let status = self.points[point as usize].status;
            self.take_out(point, status);
            self.place(point, instance);
        }
    }

    /// Returns the state of clients after the last finished frame.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.sent
    }

    /// Returns how full the tables are, and how many points did not fit.
    #[must_use]
    pub fn counts(&self) -> Occupancy {
        Occupancy { cells: self.tables.cells_used(), ..self.counts }
    }

    /// Returns the result of the last attempt to place a point; `None` for a point that is not there.
    #[must_use]
    pub fn placement(&self, point: u32) -> Option<Placement> {
        match self.points.get(point as usize)?.status {
            PointStatus::Absent => None,
            PointStatus::Stored(_) => Some(Placement::Stored),
            PointStatus::Unplaced(reason) => Some(reason),
        }
    }

    /// Writes the frame that brings clients from the last finished frame to now.
    ///
    /// A delta holds the differences from the last frame. A keyframe holds everything in use, and clears the stale
    /// cells of clients.
    ///
    /// # Errors
    /// [`EncodeError::NoKeyframe`] if the first frame is a delta. [`EncodeError::FrameOrder`] if the index does not
    /// grow. [`EncodeError::Block`] if a block cannot be compressed. No change is lost, and the next call writes them
    /// all.
    pub fn finish(&mut self, meta: FrameMeta, coder: BlockCoder) -> Result<EncodedFrame, EncodeError> {
        let frame = meta.frame;
        match self.sent.frame() {
            None if meta.kind == FrameKind::Delta => return Err(EncodeError::NoKeyframe { frame }),
            Some(last) if frame <= last => return Err(EncodeError::FrameOrder { frame, last }),
            _ => {}
        }
        self.put_due();
        self.tables.compact();
        let changes = match meta.kind {
            FrameKind::Key => TableChanges::from_all(&self.sent, &self.poses, &self.tables),
            FrameKind::Delta => {
                TableChanges::from_dirty(&self.sent, &self.poses, &mut self.dirty_poses, &self.tables)
            }
        };
        let hash = changes.hash_after(&self.sent);
        self.records.clear();
        match meta.kind {
            FrameKind::Key => push_all_records(&mut self.records, &self.poses, &self.tables, &self.layout),
            FrameKind::Delta => changes.push_records(&mut self.records, &self.sent),
        }
        let encoded = write_body(&meta, meta.kind, hash, &self.records, &mut self.compressor, coder)?;
        changes.commit(&mut self.sent);
        self.sent.hash = hash;
        self.dirty_poses.clear();
        self.tables.clear_dirty();
        self.sent.frame = Some(frame);
        Ok(encoded)
    }

    fn record(&self, point: u32) -> Result<PointRecord, PointError> {
        let count = self.points.len() as u32;
        self.points.get(point as usize).copied().ok_or(PointError::Unknown { point, count })
    }

    /// Returns a point with its instance and its number there.
    fn point_ref(&self, point: u32) -> PointRef {
        let instance = self.instance_of(point);
        PointRef { id: point, instance, number: (point - self.first_points[instance]) as usize }
    }

    fn instance_of(&self, point: u32) -> usize {
        // The last instance that starts at or before the point. Instances without points are skipped.
        self.first_points.partition_point(|first| *first <= point) - 1
    }

    /// Takes a point out of its slot, or off the list of unplaced points.
    fn take_out(&mut self, point: u32, status: PointStatus) {
        match status {
            PointStatus::Absent => return,
            PointStatus::Stored(cell) => {
                self.tables.remove(cell, point);
                *self.counts.count_mut(Placement::Stored) -= 1;
            }
            PointStatus::Unplaced(reason) => {
                self.unplaced.remove(&point);
                *self.counts.count_mut(reason) -= 1;
            }
        }
        self.points[point as usize].status = PointStatus::Absent;
    }

    /// Finds a slot for a point without one, or adds the point to the list of unplaced points.
    fn place(&mut self, point: u32, instance: usize) -> Placement {
        let layout = &self.layout.instances()[instance];
        let PointRecord { coord, word, .. } = self.points[point as usize];
        let id = cell_id(coord, layout.grid.dims());
        let bucket = layout.first_bucket + bucket_of(id, layout.bucket_count);
        let (status, placement) = match self.tables.insert(CellAddress { coord, id, bucket }, point, word) {
            Ok(cell) => (PointStatus::Stored(cell), Placement::Stored),
            Err(reason) => {
                self.unplaced.insert(point);
                (PointStatus::Unplaced(reason), reason)
            }
        };
        self.points[point as usize].status = status;
        *self.counts.count_mut(placement) += 1;
        placement
    }
}

fn check_sample(point: u32, sample: &PointSample) -> Result<(), PointError> {
    let PointSample { local, normal, .. } = *sample;
    if !local.iter().all(|axis| axis.is_finite()) {
        return Err(PointError::Position { point, local });
    }
    let sum: f32 = normal.iter().map(|axis| axis.abs()).sum();
    if sum > 0.0 && sum.is_finite() {
        return Ok(());
    }
    Err(PointError::Normal { point, normal })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::BlockError;
    use crate::envelope::SectionTag;
    use crate::paper::{Cell, PointFormat};
    use crate::testing::{layout, meta, sample};

    const STORED: BlockCoder = BlockCoder::Stored;

    fn encoder() -> Encoder {
        Encoder::new(layout(), &[20, 20]).unwrap()
    }

    fn records(frame: &EncodedFrame) -> [u32; 3] {
        [SectionTag::POSES, SectionTag::BUCKETS, SectionTag::CELLS]
            .map(|tag| frame.info.section(tag).map_or(0, |section| section.records))
    }

    #[test]
    fn arguments_that_make_no_sense_change_nothing() {
        let mut encoder = encoder();
        encoder.put(3, &sample([0.1; 3], 5)).unwrap();
        let before = format!("{encoder:?}");
        let good = sample([0.5; 3], 5);
        assert_eq!(encoder.put(40, &good), Err(PointError::Unknown { point: 40, count: 40 }));
        assert_eq!(encoder.remove(u32::MAX), Err(PointError::Unknown { point: u32::MAX, count: 40 }));
        let lost = PointSample { local: [0.0, f32::NAN, 0.0], ..good };
        assert!(matches!(encoder.put(3, &lost), Err(PointError::Position { point: 3, .. })));
        for normal in [[0.0; 3], [f32::INFINITY, 0.0, 0.0], [f32::NAN; 3], [f32::MAX; 3]] {
            let result = encoder.put(3, &PointSample { normal, ..good });
            assert!(matches!(result, Err(PointError::Normal { point: 3, .. })), "{normal:?}");
        }
        assert_eq!(encoder.set_pose(2, Pose::IDENTITY), Err(PoseError::Instance { instance: 2, count: 2 }));
        let skewed = Pose { rotation: [1.0; 4], ..Pose::IDENTITY };
        assert!(matches!(encoder.set_pose(1, skewed), Err(PoseError::Rotation { instance: 1, .. })));
        assert_eq!(format!("{encoder:?}"), before);
        let wrong = Encoder::new(layout(), &[1]).unwrap_err();
        assert_eq!(wrong, PointError::Instances { expected: 2, found: 1 });
        let many = Encoder::new(layout(), &[u32::MAX, 1]).unwrap_err();
        assert_eq!(many, PointError::TooMany { found: 1 << 32 });
    }

    #[test]
    fn frames_come_in_order_and_start_with_a_key() {
        let mut encoder = encoder();
        let frame = crate::envelope::FrameIndex(5);
        let early = encoder.finish(meta(FrameKind::Delta, 5), STORED);
        assert_eq!(early, Err(EncodeError::NoKeyframe { frame }));
        encoder.finish(meta(FrameKind::Key, 5), STORED).unwrap();
        for kind in [FrameKind::Key, FrameKind::Delta] {
            let again = encoder.finish(meta(kind, 5), STORED);
            assert_eq!(again, Err(EncodeError::FrameOrder { frame, last: frame }));
        }
    }

    #[test]
    fn a_frame_that_fails_loses_no_change() {
        let mut encoder = encoder();
        encoder.finish(meta(FrameKind::Key, 0), STORED).unwrap();
        encoder.put(7, &sample([0.3; 3], 9)).unwrap();
        let before = encoder.state().clone();
        let failed = encoder.finish(meta(FrameKind::Delta, 1), BlockCoder::Zstd { level: 99 }).unwrap_err();
        let (section, source) = (SectionTag::BUCKETS, BlockError::Level { level: 99 });
        assert_eq!(failed, EncodeError::Block { section, source });
        assert_eq!(encoder.state(), &before);
        let frame = encoder.finish(meta(FrameKind::Delta, 1), STORED).unwrap();
        assert_eq!(records(&frame), [0, 1, 1]);
    }

    #[test]
    fn a_frame_holds_what_changed_and_nothing_else() {
        let mut encoder = encoder();
        for point in 0..10 {
            encoder.put(point, &sample([0.1 * point as f32, 0.1, 0.1], 200)).unwrap();
        }
        encoder.finish(meta(FrameKind::Key, 0), STORED).unwrap();
        let mut next = 1;
        let mut frame = |encoder: &mut Encoder| {
            next += 1;
            records(&encoder.finish(meta(FrameKind::Delta, next), STORED).unwrap())
        };
        assert_eq!(frame(&mut encoder), [0, 0, 0]);
        // The same value again, and a value that comes back, are no change.
        encoder.put(0, &sample([0.0, 0.1, 0.1], 200)).unwrap();
        encoder.put(1, &sample([0.1, 0.1, 0.1], 7)).unwrap();
        encoder.put(1, &sample([0.1, 0.1, 0.1], 200)).unwrap();
        encoder.set_pose(0, Pose::IDENTITY).unwrap();
        assert_eq!(frame(&mut encoder), [0, 0, 0]);
        encoder.put(1, &sample([0.1, 0.1, 0.1], 7)).unwrap();
        assert_eq!(frame(&mut encoder), [0, 0, 1]);
        // Points 8 and 9 are alone in their cell. Freeing it sends its bucket only.
        encoder.remove(8).unwrap();
        encoder.remove(9).unwrap();
        assert_eq!(frame(&mut encoder), [0, 1, 0]);
    }

    #[test]
    fn freed_cells_stay_stale_until_the_next_key() {
        let mut encoder = encoder();
        encoder.put(0, &sample([0.1; 3], 200)).unwrap();
        encoder.finish(meta(FrameKind::Key, 0), STORED).unwrap();
        encoder.remove(0).unwrap();
        encoder.finish(meta(FrameKind::Delta, 1), STORED).unwrap();
        let stale = encoder.state().cells()[0];
        assert_eq!(stale.points(PointFormat::Bits32).count(), 1);
        assert_eq!(encoder.state().lookup(0, [0; 3]), None);
        // The cell is used again: what is sent is the difference to the stale words.
        encoder.put(5, &sample([0.1 + 0.25; 3], 201)).unwrap();
        let frame = encoder.finish(meta(FrameKind::Delta, 2), STORED).unwrap();
        assert_eq!(frame.body[frame.body.len() - 28..][..4], [200 ^ 201, 0, 0, 0]);
        encoder.remove(5).unwrap();
        let key = encoder.finish(meta(FrameKind::Key, 3), STORED).unwrap();
        assert_eq!(records(&key), [0, 0, 0]);
        assert_eq!(encoder.state().cells()[0], Cell::default());
        assert_eq!(encoder.state().hash(), crate::StateHash(0));
    }

    #[test]
    fn the_unplaced_move_in_when_there_is_room() {
        let mut encoder = encoder();
        for point in 0..9 {
            let placed = encoder.put(point, &sample([0.1; 3], point as u8)).unwrap();
            let expected = if point < 7 { Placement::Stored } else { Placement::CellFull };
            assert_eq!(placed, PutOutcome { placement: expected, outside: false });
        }
        let full = encoder.counts();
        assert_eq!((full.cells, full.points_stored, full.cell_full, full.unplaced()), (1, 7, 2, 2));
        encoder.retry_unplaced();
        assert_eq!(encoder.counts(), full);
        encoder.remove(3).unwrap();
        encoder.retry_unplaced();
        assert_eq!(
            (encoder.placement(7), encoder.placement(8)),
            (Some(Placement::Stored), Some(Placement::CellFull))
        );
        encoder.remove(8).unwrap();
        assert_eq!((encoder.counts().unplaced(), encoder.placement(8)), (0, None));
    }

    #[test]
    fn points_outside_are_counted_while_they_are() {
        let mut encoder = encoder();
        assert!(encoder.put(0, &sample([-5.0, 0.1, 0.1], 1)).unwrap().outside);
        assert!(encoder.put(1, &sample([9.0; 3], 1)).unwrap().outside);
        assert_eq!(encoder.counts().outside_grid, 2);
        assert!(!encoder.put(0, &sample([0.1; 3], 1)).unwrap().outside);
        encoder.remove(1).unwrap();
        assert_eq!(encoder.counts().outside_grid, 0);
    }

    #[test]
    fn cells_that_share_a_raw_id_are_told_apart_and_counted() {
        let grid = crate::paper::Grid::new([0.0; 3], 1.0, [260, 260, 2050]).unwrap();
        let instance =
            crate::paper::InstanceLayout { grid, first_bucket: 0, bucket_count: 4, kernel_radius: 0.5 };
        let layout = Layout::new(PointFormat::Bits32, vec![instance], 8, &crate::Limits::default()).unwrap();
        let mut encoder = Encoder::new(Arc::new(layout), &[3]).unwrap();
        let (one, other) = (sample([4.5, 0.5, 0.5], 1), sample([0.5, 245.5, 2049.5], 2));
        assert_eq!(encoder.put(0, &one).unwrap().placement, Placement::Stored);
        assert_eq!(encoder.put(1, &other).unwrap().placement, Placement::IdCollision);
        assert_eq!(encoder.counts().id_collisions, 1);
        encoder.remove(0).unwrap();
        encoder.retry_unplaced();
        assert_eq!((encoder.placement(1), encoder.counts().id_collisions), (Some(Placement::Stored), 0));
    }
}
