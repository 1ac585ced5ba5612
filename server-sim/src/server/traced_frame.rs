//! A traced frame: what the encoder takes from the points, so that the next frame can be traced while this one is encoded.

use psao_codec::Encoder;
use psao_codec::envelope::FrameIndex;
use psao_codec::paper::{PointSample, Pose};
use psao_codec::surface::{BLOCK_POINTS, NO_VALUE, SetLayout};
use psao_proto::message::CameraPose;

use super::field::{Chunk, TracedPoint};
use super::screen_area::ScreenArea;
use super::stats::Traces;
use super::trace_state::TraceState;
use super::{FrameStats, ServerError};
use crate::points::PointId;
use crate::scene::InstanceId;
use crate::visibility::Overlap;
use crate::world::InstanceChange;

/// Least differences of AO that are sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Thresholds {
    pub(super) usual: u8,
    /// Of points that no picture needs.
    pub(super) unseen: u8,
}

impl Thresholds {
    /// Returns the threshold of a point.
    fn of(self, point: &TracedPoint) -> u8 {
        if point.seen { self.usual } else { self.unseen }
    }
}

/// What the encoder of a stream asks for.
#[derive(Debug, Clone, Copy)]
pub(super) struct EncoderNeeds {
    /// Places of points, and poses.
    places: bool,
    /// How large points are on the screen.
    weights: bool,
}

impl EncoderNeeds {
    pub(super) fn of(encoder: &Encoder) -> Self {
        Self { places: encoder.needs_places(), weights: encoder.needs_weights() }
    }
}

/// A frame that was traced, with all that the encoder needs of it. [`EncodeStage::encode`](super::EncodeStage::encode) takes
/// the frames in the order in which they were traced, none left out.
#[derive(Debug)]
pub struct TracedFrame {
    pub(super) traces: Traces,
    /// Points in view: the encoder's id, AO, and the least difference that is sent.
    points: Vec<(u32, u8, u8)>,
    /// Their positions and normals, where the encoder needs them.
    places: Vec<([f32; 3], [f32; 3])>,
    /// Instances that moved, where the encoder needs them.
    poses: Vec<(u32, Pose)>,
    /// Points that clients have and that are out of view: their AO is not traced.
    out_of_view: Vec<PointId>,
    /// Instance, block and how large its points are on the screen; only with a byte budget.
    weights: Vec<(u32, usize, u16)>,
}

impl TracedFrame {
    /// Takes what is in view from the points. In the first frame the order is that in which clients need it: what the cameras
    /// see first, the nearest to the first of them before all.
    pub(super) fn new(state: &TraceState, traces: Traces, needs: EncoderNeeds) -> Self {
        let (chunks, cameras, first) = (state.field.chunks(), &state.cameras, traces.first);
        let order = if first { in_view_first(state, cameras) } else { (0..chunks.len()).collect() };
        let weights = if needs.weights { weights(state, cameras) } else { Vec::new() };
        let mut frame = Self {
            traces,
            points: Vec::new(),
            out_of_view: Vec::new(),
            places: Vec::new(),
            poses: Vec::new(),
            weights,
        };
        if needs.places {
            frame.poses = poses(state, first);
            order.into_iter().for_each(|chunk| frame.place(state, &chunks[chunk]));
        } else {
            // An AO of 0 is sent as 1.
            let byte = |ao: u8, buried: bool| if buried { NO_VALUE } else { ao.max(NO_VALUE + 1) };
            let seen = |chunk: usize| {
                let points = state.field.visible(&chunks[chunk]);
                points
                    .map(move |point| (point.id.0, byte(point.ao, point.buried), state.thresholds.of(&point)))
            };
            frame.points = order.into_iter().flat_map(seen).collect();
            frame.out_of_view = chunks.iter().flat_map(|chunk| state.field.out_of_view(chunk)).collect();
        }
        frame
    }

    /// Returns the frame's number.
    #[must_use]
    pub fn index(&self) -> FrameIndex {
        self.traces.index
    }

    /// Returns what the frame took so far; what will be sent is not known yet.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        FrameStats::of(&self.traces)
    }

    /// Adds a chunk with its places. The encoder knows a point by its number in the order in which points were made, whatever
    /// order they are kept in: so the bytes are the same.
    fn place(&mut self, state: &TraceState, chunk: &Chunk) {
        let (numbers, local) = (state.numbers(chunk.instance), state.field.placed().local(chunk.instance));
        let first = state.points.offsets()[chunk.instance];
        for TracedPoint { place, ao, .. } in state.field.visible(chunk) {
            let at = &local[place.index()];
            self.points.push((first + numbers[place.index()], ao, 0));
            self.places.push((at.position.to_array(), at.normal.to_array()));
        }
    }

    /// Gives all of it to the encoder; returns how many points the next frame sends.
    pub(super) fn give(self, encoder: &mut Encoder) -> Result<u32, ServerError> {
        for (instance, pose) in self.poses {
            encoder.set_pose(instance, pose)?;
        }
        self.out_of_view.into_iter().for_each(|point| encoder.release(point.0));
        let mut changed = 0;
        let places = self.places.into_iter().chain(std::iter::repeat(<([f32; 3], [f32; 3])>::default()));
        for ((point, ao, threshold), (local, normal)) in self.points.into_iter().zip(places) {
            changed += u32::from(encoder.set_point(point, &PointSample { local, normal, ao }, threshold)?);
        }
        for (instance, block, weight) in self.weights {
            encoder.set_weight(instance, block, weight);
        }
        Ok(changed)
    }
}

/// Poses of the instances that moved, in the first frame of all.
fn poses(state: &TraceState, first: bool) -> Vec<(u32, Pose)> {
    let moved = |instance: usize| first || state.world.changes()[instance] != InstanceChange::Unchanged;
    let instances = state.pose.instances().iter().enumerate().filter(|(instance, _)| moved(*instance));
    let pose = |(instance, at): (usize, &crate::scene::InstancePose)| {
        let (translation, rotation) = (at.frame().translation.to_array(), at.frame().rotation.to_array());
        (instance as u32, Pose { translation, rotation })
    };
    instances.map(pose).collect()
}

/// Blocks that cameras see in a state, the nearest first.
pub(super) fn blocks_in_view(state: &TraceState, cameras: &[CameraPose]) -> Vec<(u32, u32)> {
    let blocks = |chunk: usize| {
        let Chunk { instance, points, .. } = &state.field.chunks()[chunk];
        let blocks = points.start / BLOCK_POINTS..points.end.div_ceil(BLOCK_POINTS);
        let instance = *instance as u32;
        blocks.map(move |block| (instance, block as u32))
    };
    in_view(state, cameras).into_iter().flat_map(blocks).collect()
}

/// Weight of every block: how large its points are on the screen.
fn weights(state: &TraceState, cameras: &[CameraPose]) -> Vec<(u32, usize, u16)> {
    let near = ScreenArea::new(cameras);
    let mut weights = Vec::new();
    for Chunk { instance, points, .. } in state.field.chunks() {
        let at = state.world.placement(InstanceId(*instance as u32));
        let local = state.field.placed().local(*instance);
        let set = &state.points.sets()[state.scene.instances()[*instance].rest().index()];
        for first in points.clone().step_by(BLOCK_POINTS) {
            let last = points.end.min(first + BLOCK_POINTS) - 1;
            let middle = at.point(local[usize::midpoint(first, last)].position);
            let level = |layout: &SetLayout| {
                layout.level_radius(layout.levels.of_point(first as u32)) / layout.kernel_radius
            };
            let radius = set.radius() * set.at_rest().map_or(1.0, level);
            weights.push((*instance as u32, first / BLOCK_POINTS, near.weight(middle, radius)));
        }
    }
    weights
}

/// Numbers of all chunks: those in view first, then the others in their order.
pub(super) fn in_view_first(state: &TraceState, cameras: &[CameraPose]) -> Vec<usize> {
    let mut order = in_view(state, cameras);
    let mut waiting = vec![true; state.field.chunks().len()];
    order.iter().for_each(|&chunk| waiting[chunk] = false);
    order.extend((0..waiting.len()).filter(|&chunk| waiting[chunk]));
    order
}

/// Numbers of the chunks that some camera sees, by their distance from the first camera.
fn in_view(state: &TraceState, cameras: &[CameraPose]) -> Vec<usize> {
    let (Some(views), [camera, ..]) = (state.views(cameras), cameras) else { return Vec::new() };
    let eye = camera.eye.into();
    let seen = |(number, chunk): (usize, &Chunk)| {
        let bounds = state.field.bounds(&state.world, chunk);
        let middle = (bounds.min() + bounds.max()) * 0.5;
        let outside = views.overlap(middle, bounds.size().length() * 0.5) == Overlap::Outside;
        (!outside).then(|| (bounds.distance_squared(eye), number))
    };
    let mut order: Vec<(f32, usize)> = state.field.chunks().iter().enumerate().filter_map(seen).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().map(|(_, number)| number).collect()
}
