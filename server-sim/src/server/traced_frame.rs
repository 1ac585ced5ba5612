//! What a stream takes from the points of a frame, so that the next one can be traced while this one is written.

use psao_codec::Encoder;
use psao_codec::paper::{PointSample, Pose};
use psao_codec::surface::BLOCK_POINTS;
use psao_proto::message::CameraPose;

use super::ServerError;
use super::field::Chunk;
use super::screen_area::ScreenArea;
use super::tracing::Tracing;
use crate::scene::InstanceId;
use crate::visibility::Overlap;
use crate::world::InstanceChange;

/// What the encoder of a stream asks for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Needs {
    /// Places of points, and poses.
    places: bool,
    /// How large points are on the screen.
    weights: bool,
}

impl Needs {
    pub(super) fn of(encoder: &Encoder) -> Self {
        Self { places: encoder.needs_places(), weights: encoder.needs_weights() }
    }
}

/// What a stream takes from the points of a frame.
#[derive(Debug)]
pub(super) struct Gathered {
    /// Points in view by the encoder's ids, and their AO.
    points: Vec<(u32, u8)>,
    /// Their positions and normals, where the encoder needs them.
    places: Vec<([f32; 3], [f32; 3])>,
    /// Instances that moved, where the encoder needs them.
    poses: Vec<(u32, Pose)>,
    /// Instance, block and how large its points are on the screen; only with a byte budget.
    weights: Vec<(u32, usize, u16)>,
    pub(super) cameras: Vec<CameraPose>,
}

impl Gathered {
    /// What is in view. In the first frame the order is that in which clients need it: what `cameras` see first, the
    /// nearest to the first of them before all.
    pub(super) fn new(tracing: &Tracing, cameras: &[CameraPose], first: bool, needs: Needs) -> Self {
        let chunks = tracing.field.chunks();
        let order = if first { in_view_first(tracing, cameras) } else { (0..chunks.len()).collect() };
        let weights = if needs.weights { weights(tracing, cameras) } else { Vec::new() };
        let mut gathered = Self {
            points: Vec::new(),
            places: Vec::new(),
            poses: Vec::new(),
            weights,
            cameras: cameras.to_vec(),
        };
        if needs.places {
            gathered.poses = poses(tracing, first);
            order.into_iter().for_each(|chunk| gathered.place(tracing, &chunks[chunk]));
        } else {
            let seen =
                |chunk: usize| tracing.field.visible(&chunks[chunk]).map(|(_, point, ao)| (point.0, ao));
            gathered.points = order.into_iter().flat_map(seen).collect();
        }
        gathered
    }

    /// Adds a chunk with its places. The encoder knows a point by its number in the order in which points were made, whatever
    /// order they are kept in: so the bytes are the same.
    fn place(&mut self, tracing: &Tracing, chunk: &Chunk) {
        let (numbers, local) =
            (tracing.numbers(chunk.instance), tracing.field.placed().local(chunk.instance));
        let first = tracing.points.offsets()[chunk.instance];
        for (place, _, ao) in tracing.field.visible(chunk) {
            let at = &local[place.index()];
            self.points.push((first + numbers[place.index()], ao));
            self.places.push((at.position.to_array(), at.normal.to_array()));
        }
    }

    /// Gives all of it to the encoder; how many points the next frame sends.
    pub(super) fn give(&self, encoder: &mut Encoder) -> Result<u32, ServerError> {
        for (instance, pose) in &self.poses {
            encoder.set_pose(*instance, *pose)?;
        }
        let mut changed = 0;
        let places = self.places.iter().copied().chain(std::iter::repeat(<([f32; 3], [f32; 3])>::default()));
        for ((point, ao), (local, normal)) in self.points.iter().zip(places) {
            changed += u32::from(encoder.set_point(*point, &PointSample { local, normal, ao: *ao })?);
        }
        for (instance, block, weight) in &self.weights {
            encoder.set_weight(*instance, *block, *weight);
        }
        Ok(changed)
    }
}

/// Poses of the instances that moved, in the first frame of all.
fn poses(tracing: &Tracing, first: bool) -> Vec<(u32, Pose)> {
    let moved = |instance: usize| first || tracing.world.changes()[instance] != InstanceChange::Unchanged;
    let instances = tracing.pose.instances().iter().enumerate().filter(|(instance, _)| moved(*instance));
    let pose = |(instance, at): (usize, &crate::scene::InstancePose)| {
        let (translation, rotation) = (at.frame().translation.to_array(), at.frame().rotation.to_array());
        (instance as u32, Pose { translation, rotation })
    };
    instances.map(pose).collect()
}

/// Blocks that cameras see in a tracing, the nearest first.
pub(super) fn blocks_in_view(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<(u32, u32)> {
    let blocks = |chunk: usize| {
        let Chunk { instance, points, .. } = &tracing.field.chunks()[chunk];
        let blocks = points.start / BLOCK_POINTS..points.end.div_ceil(BLOCK_POINTS);
        let instance = *instance as u32;
        blocks.map(move |block| (instance, block as u32))
    };
    in_view(tracing, cameras).into_iter().flat_map(blocks).collect()
}

/// Weight of every block: how large its points are on the screen.
fn weights(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<(u32, usize, u16)> {
    let near = ScreenArea::new(cameras);
    let mut weights = Vec::new();
    for Chunk { instance, points, .. } in tracing.field.chunks() {
        let at = tracing.world.placement(InstanceId(*instance as u32));
        let local = tracing.field.placed().local(*instance);
        let set = &tracing.points.sets()[tracing.scene.instances()[*instance].rest().index()];
        for first in points.clone().step_by(BLOCK_POINTS) {
            let last = points.end.min(first + BLOCK_POINTS) - 1;
            let middle = at.point(local[usize::midpoint(first, last)].position);
            weights.push((*instance as u32, first / BLOCK_POINTS, near.weight(middle, set.radius())));
        }
    }
    weights
}

/// Numbers of all chunks: those in view first, then the others in their order.
pub(super) fn in_view_first(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<usize> {
    let mut order = in_view(tracing, cameras);
    let mut waiting = vec![true; tracing.field.chunks().len()];
    order.iter().for_each(|&chunk| waiting[chunk] = false);
    order.extend((0..waiting.len()).filter(|&chunk| waiting[chunk]));
    order
}

/// Numbers of the chunks that some camera sees, by their distance from the first camera.
fn in_view(tracing: &Tracing, cameras: &[CameraPose]) -> Vec<usize> {
    let (Some(views), [camera, ..]) = (tracing.views(cameras), cameras) else { return Vec::new() };
    let eye = camera.eye.into();
    let seen = |(number, chunk): (usize, &Chunk)| {
        let bounds = tracing.field.bounds(&tracing.world, chunk);
        let middle = (bounds.min() + bounds.max()) * 0.5;
        let outside = views.overlap(middle, bounds.size().length() * 0.5) == Overlap::Outside;
        (!outside).then(|| (bounds.distance_squared(eye), number))
    };
    let mut order: Vec<(f32, usize)> = tracing.field.chunks().iter().enumerate().filter_map(seen).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().map(|(_, number)| number).collect()
}
