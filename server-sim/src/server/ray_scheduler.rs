//! Which points are traced in a frame when there is no time for all of them.

use psao_codec::{memory, setters};
use psao_proto::message::CameraPose;

use super::field::Field;
use super::screen_area::ScreenArea;
use crate::points::ScenePoints;
use crate::scene::InstanceId;
use crate::world::SceneBvh;

/// Rays that a frame may take, and how long points wait at most because of it.
///
/// Points are chosen in chunks of up to 256 neighbours: those that are largest on the screen, weighed by how long they
/// have waited, until the rays are used up; at least one chunk in every frame. A chunk that has waited for `longest_age`
/// frames goes before all that have waited for less, the oldest first. So no point that stays in view waits for more than
/// `longest_age + ceil(C / c)` frames, where C chunks are in view and c are traced a frame. A point that waits keeps the AO
/// that it had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RayBudget {
    /// Rays a frame. The first frame, which makes the AO of all points that clients get, takes what it takes.
    pub rays: u64,
    /// Frames after which a point goes before what is larger on the screen.
    pub longest_age: u16,
}

impl RayBudget {
    /// Half a second at 60 Hz.
    pub const LONGEST_AGE: u16 = 30;

    /// Returns a budget of `rays` rays a frame, with [`LONGEST_AGE`](Self::LONGEST_AGE).
    #[must_use]
    pub const fn new(rays: u64) -> Self {
        Self { rays, longest_age: Self::LONGEST_AGE }
    }

    setters! {
        const fn:
        with_rays: rays as u64,
        with_longest_age: longest_age as u16,
    }
}

/// What a frame left for later ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayBacklog {
    /// Points in view whose AO is not what tracing them now would give.
    pub points: u32,
    /// Frames that the oldest of them has waited.
    pub oldest: u16,
}

/// Chooses the chunks.
#[derive(Debug)]
pub(super) struct RayScheduler {
    /// By chunk.
    states: Vec<ChunkState>,
}

#[derive(Clone, Copy, Debug)]
struct ChunkState {
    /// Frames that stale points in view have waited.
    age: u16,
    /// Rays that a point took when the chunk was last traced.
    rays_a_point: f32,
    /// Whether it is traced in this frame.
    chosen: bool,
}

impl RayScheduler {
    /// Bytes held.
    pub(super) fn heap_bytes(&self) -> usize {
        memory::list(&self.states)
    }

    /// Nothing has waited yet. `rays` is what a point takes that is not known better.
    pub(super) fn new(chunks: usize, rays: u32) -> Self {
        let state = ChunkState { age: 0, rays_a_point: rays as f32, chosen: true };
        Self { states: vec![state; chunks] }
    }

    /// Whether a chunk is traced in this frame.
    pub(super) fn is_chosen(&self, chunk: usize) -> bool {
        self.states[chunk].chosen
    }

    /// Everything is traced.
    pub(super) fn choose_all(&mut self) {
        self.states.iter_mut().for_each(|state| state.chosen = true);
    }

    /// Chooses what is traced, `stale` being the stale points in view of each chunk.
    pub(super) fn choose(
        &mut self,
        budget: RayBudget,
        stale: &[u32],
        place: (&SceneBvh, &ScenePoints, &Field),
        cameras: &[CameraPose],
    ) {
        let near = ScreenArea::new(cameras);
        let mut order: Vec<(bool, u64, usize)> = Vec::new();
        for (chunk, (state, &stale)) in self.states.iter_mut().zip(stale).enumerate() {
            state.chosen = false;
            if stale == 0 {
                continue;
            }
            let overdue = state.age >= budget.longest_age;
            let age = u64::from(state.age) + 1;
            let urgency = if overdue { age } else { u64::from(weight(&near, place, chunk)) * age };
            order.push((overdue, urgency, chunk));
        }
        order.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(b.1.cmp(&a.1)).then(a.2.cmp(&b.2)));
        let mut rays = 0.0;
        for (_, _, chunk) in order {
            if rays >= budget.rays as f64 {
                break;
            }
            let state = &mut self.states[chunk];
            rays += f64::from(stale[chunk]) * f64::from(state.rays_a_point);
            state.chosen = true;
        }
    }

    /// The frame is over: `traced` has points and rays of each chunk, `stale` its stale points in view before. What is left.
    pub(super) fn settle(&mut self, traced: impl Iterator<Item = (u32, u64)>, stale: &[u32]) -> RayBacklog {
        let mut waiting = RayBacklog::default();
        for ((state, (points, rays)), &stale) in self.states.iter_mut().zip(traced).zip(stale) {
            if state.chosen || stale == 0 {
                state.age = 0;
                if points > 0 {
                    state.rays_a_point = rays as f32 / points as f32;
                }
            } else {
                state.age = state.age.saturating_add(1);
                waiting.points += stale;
                waiting.oldest = waiting.oldest.max(state.age);
            }
        }
        waiting
    }
}

/// How large the points of a chunk are on the screen.
fn weight(near: &ScreenArea, (world, points, field): (&SceneBvh, &ScenePoints, &Field), chunk: usize) -> u16 {
    let chunk = &field.chunks()[chunk];
    let middle = field.placed().local(chunk.instance)[usize::midpoint(chunk.points.start, chunk.points.end)];
    let at = world.placement(InstanceId(chunk.instance as u32));
    let set = &points.sets()[world.scene().instances()[chunk.instance].rest().index()];
    near.weight(at.point(middle.position), set.radius())
}
