//! All points of the scene: where they are now, and what is known about their AO.
//!
//! Points are worked on in chunks of neighbours. A chunk belongs to one instance, has bounds, and is visited by one
//! thread at a time; results are put together in the order of the chunks, so nothing depends on the number of threads.

use std::ops::Range;

use psao_codec::memory::list;
use psao_codec::surface::{BLOCK_POINTS, SetLayout};
use rayon::prelude::*;

use super::hit_cache::{self, ChunkHitCache};
use super::places::{Places, PointPlaces};
use super::sight::{OUT_OF_VIEW, Sight};
use crate::bvh::Bounds;
use crate::points::{PlacedPoint, PointId, PointInSet, PointSet, ScenePoints};
use crate::scene::{InstanceId, Motion, PosedMesh};
use crate::shortcuts::Shortcuts;
use crate::visibility::{Overlap, Views};
use crate::world::{InstanceChange, SceneBvh, SweptBounds};

/// Points of a chunk: few enough to share out, many enough to be worth it.
const CHUNK_POINTS: usize = 256;

/// What is known about a point, as bits.
pub(super) mod flag {
    /// Its AO byte is what tracing it now would give.
    pub(crate) const FRESH: u8 = 1;
    /// When it was last traced, nothing but its own body was within reach, and that body has not deformed since.
    pub(crate) const ALONE: u8 = 2;
    /// It is in view in this frame.
    pub(crate) const VISIBLE: u8 = 4;
    /// It lies inside a solid.
    pub(crate) const BURIED: u8 = 8;
    /// Clients have its block, or are about to get it.
    pub(crate) const ACTIVE: u8 = 16;
    /// In view, and clients have it.
    pub(crate) const SHOWN: u8 = VISIBLE | ACTIVE;
}

/// Blocks of a chunk.
const CHUNK_BLOCKS: usize = CHUNK_POINTS / BLOCK_POINTS;

/// The reach of a client's fit in Poisson-disk radii of points that are in no stream's order.
const REACH_RADII: f32 = 2.8;

/// Distance, in points, of those that are looked at to find the size of a pixel on a block.
const PIXEL_STEP: usize = 8;
/// Factor on the size of a pixel that was found so: other points of the block may be nearer to a camera.
const PIXEL_FACTOR: f32 = 0.9;
/// Factor on the size of a pixel for blocks that clients have. It keeps blocks at the limit from coming and going.
const HOLD_FACTOR: f32 = 0.8;

/// A run of points of one instance.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    pub(super) instance: usize,
    /// The first one.
    pub(super) first: PointId,
    /// Places within the instance.
    pub(super) points: Range<usize>,
    /// Bounds in the space of the points' bodies; only of instances that do not deform.
    bounds: Bounds,
    /// By block: the coarsest level of its points.
    levels: [u8; CHUNK_BLOCKS],
}

/// The part of the field that belongs to a chunk.
pub(super) struct FieldPart<'a> {
    pub(super) chunk: &'a Chunk,
    pub(super) flags: &'a mut [u8],
    pub(super) ao: &'a mut [u8],
    /// Empty unless the field keeps them.
    pub(super) exact: &'a mut [f32],
    /// Frames for which each point still counts as seen, see [`Sight`](super::sight::Sight).
    pub(super) seen: &'a mut [u8],
    /// AO byte, at least 1, for which it was last found out whether each point is buried; 0 where it was not.
    pub(super) dug: &'a mut [u8],
    /// By block: the level that the view asks for.
    wanted: &'a mut [u8; CHUNK_BLOCKS],
    pub(super) memory: &'a mut ChunkHitCache,
}

/// A point in view as it was traced.
#[derive(Clone, Copy, Debug)]
pub(super) struct TracedPoint {
    pub(super) place: PointInSet,
    pub(super) id: PointId,
    /// AO byte.
    pub(super) ao: u8,
    /// Whether it lies inside a solid.
    pub(super) buried: bool,
    /// Whether a picture needs it.
    pub(super) seen: bool,
}

/// The points of a scene.
#[derive(Debug)]
pub(super) struct Field {
    chunks: Vec<Chunk>,
    flags: Vec<u8>,
    ao: Vec<u8>,
    /// Frames for which each point still counts as seen.
    seen: Vec<u8>,
    /// AO bytes for which it was last found out whether points are buried.
    dug: Vec<u8>,
    /// By chunk and block: the level that the view asks for.
    wanted: Vec<[u8; CHUNK_BLOCKS]>,
    /// Distance of points that the view asks for, pixels; `None` if it asks for all points everywhere.
    quality: Option<f32>,
    /// AO as traced, not rounded; empty unless asked for.
    exact: Vec<f32>,
    /// What rays met, by chunk.
    memories: Vec<ChunkHitCache>,
    /// Points in instance-local space, by instance; those of instances that do not deform are shared by set.
    places: Vec<Places>,
    shared: Vec<Vec<PlacedPoint>>,
    /// Points in world space of instances in a static batch; empty for others.
    worlds: Vec<Vec<PlacedPoint>>,
    /// Whether only points of deforming instances have places of their own.
    rigid: bool,
}

impl Field {
    /// The field of a scene. With `exact` it keeps the AO of every point as it was traced, besides its byte.
    pub(super) fn new(
        world: &SceneBvh,
        points: &ScenePoints,
        exact: bool,
        shortcuts: Shortcuts,
        quality: Option<f32>,
    ) -> Self {
        let scene = world.scene();
        let instances = scene.instances();
        let shared = (0..points.sets().len()).into_par_iter().map(|rest| {
            let of_rest = |motion: fn(Motion) -> bool| {
                instances.iter().any(|instance| instance.rest().index() == rest && motion(instance.motion()))
            };
            if !of_rest(|motion| motion != Motion::Deforming) {
                return Vec::new();
            }
            let posed = PosedMesh::at_rest(scene, &scene.rests()[rest]);
            points.sets()[rest].points().iter().map(|point| point.place_on(&posed)).collect()
        });
        let shared: Vec<Vec<PlacedPoint>> = shared.collect();
        let mut field = Self {
            chunks: Vec::new(),
            flags: vec![0; points.total() as usize],
            ao: vec![0; points.total() as usize],
            seen: vec![OUT_OF_VIEW; points.total() as usize],
            dug: vec![0; points.total() as usize],
            wanted: Vec::new(),
            quality,
            exact: if exact { vec![0.0; points.total() as usize] } else { Vec::new() },
            memories: Vec::new(),
            places: Vec::new(),
            worlds: Vec::new(),
            shared,
            rigid: shortcuts.contains(Shortcuts::RIGID),
        };
        for (index, instance) in instances.iter().enumerate() {
            let rest = instance.rest().index();
            let own = instance.motion() == Motion::Deforming || !field.rigid;
            field.places.push(if own { Places::Own(Vec::new()) } else { Places::Shared(rest) });
            let at = world.placement(InstanceId(index as u32));
            let in_world = |point: &PlacedPoint| PlacedPoint {
                position: at.point(point.position),
                normal: at.direction(point.normal),
                edge: at.direction(point.edge),
            };
            let placed = if world.is_still(index) {
                field.shared[rest].iter().map(in_world).collect()
            } else {
                Vec::new()
            };
            field.worlds.push(placed);
            let count = points.sets()[rest].points().len();
            let layout = points.sets()[rest].at_rest();
            let level = |point: usize| layout.map_or(0, |layout| layout.levels.of_point(point as u32));
            let first = |start: usize| points.id(index, PointInSet(start as u32));
            let ranges = (0..count).step_by(CHUNK_POINTS).map(|start| start..count.min(start + CHUNK_POINTS));
            field.chunks.extend(ranges.map(|points| Chunk {
                instance: index,
                first: first(points.start),
                levels: std::array::from_fn(|block| level(points.start + block * BLOCK_POINTS)),
                points,
                bounds: Bounds::EMPTY,
            }));
        }
        field.memories.resize_with(field.chunks.len(), ChunkHitCache::default);
        field.wanted = vec![[u8::MAX; CHUNK_BLOCKS]; field.chunks.len()];
        for chunk in &field.chunks {
            let flags = &mut field.flags[chunk.first.index()..][..chunk.points.len()];
            for (flags, level) in flags.chunks_mut(BLOCK_POINTS).zip(chunk.levels) {
                if level == 0 || quality.is_none() {
                    flags.fill(flag::ACTIVE);
                }
            }
        }
        field.place(world, points, true);
        field.measure(|_| true);
        field
    }

    /// Bytes held, but for what points remember of their rays.
    pub(super) fn heap_bytes(&self) -> usize {
        let Self { chunks, flags, ao, seen, dug, wanted, exact, memories, places, shared, worlds, .. } = self;
        let own = |places: &Places| match places {
            Places::Shared(_) => 0,
            Places::Own(points) => size_of_val(points.as_slice()),
        };
        let placed = |lists: &Vec<Vec<PlacedPoint>>| {
            list(lists) + lists.iter().map(|points| size_of_val(points.as_slice())).sum::<usize>()
        };
        let places = list(places) + places.iter().map(own).sum::<usize>();
        let known = list(flags) + list(ao) + list(seen) + list(dug) + list(wanted) + list(exact);
        list(chunks) + known + list(memories) + places + placed(shared) + placed(worlds)
    }

    /// Measures the chunks of some instances in the space of their bodies.
    fn measure(&mut self, of: impl Fn(usize) -> bool) {
        let mut chunks = std::mem::take(&mut self.chunks);
        for chunk in chunks.iter_mut().filter(|chunk| of(chunk.instance)) {
            let placed = &self.placed().in_body_space(chunk.instance)[chunk.points.clone()];
            chunk.bounds = Bounds::around(placed.iter().map(|point| point.position));
        }
        self.chunks = chunks;
    }

    /// Places the points of instances that deformed. Moves those of detached instances from the space of the world to that
    /// of their own body.
    pub(super) fn place(&mut self, world: &SceneBvh, points: &ScenePoints, all: bool) {
        let detached = |instance: usize| matches!(world.changes()[instance], InstanceChange::Detached(_));
        if (0..self.worlds.len()).any(detached) {
            (0..)
                .zip(&mut self.worlds)
                .filter(|(instance, _)| detached(*instance))
                .for_each(|(_, placed)| placed.clear());
            self.measure(detached);
        }
        let all = all || !self.rigid;
        self.places.par_iter_mut().enumerate().for_each(|(instance, places)| {
            let Places::Own(own) = places else { return };
            if !all && !matches!(world.changes()[instance], InstanceChange::Deformed(_)) {
                return;
            }
            let Some(posed) = world.posed(InstanceId(instance as u32)) else { return };
            let set = &points.sets()[world.scene().instances()[instance].rest().index()];
            own.clear();
            own.extend(set.points().iter().map(|point| point.place_on(&posed)));
        });
    }

    /// Where the points are.
    pub(super) fn placed(&self) -> PointPlaces<'_> {
        PointPlaces { places: &self.places, shared: &self.shared, worlds: &self.worlds }
    }

    /// The chunks, in the order of their points.
    pub(super) fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Points of a chunk that are in view and that clients have, as last traced.
    pub(super) fn visible(&self, chunk: &Chunk) -> impl Iterator<Item = TracedPoint> + '_ {
        let first = chunk.first.index();
        let range = first..first + chunk.points.len();
        let values = self.flags[range.clone()].iter().zip(&self.ao[range.clone()]).zip(&self.seen[range]);
        (chunk.points.start as u32..)
            .zip(chunk.first.0..)
            .zip(values)
            .filter(|(_, ((flags, _), _))| is_shown(**flags))
            .map(|((place, point), ((flags, ao), seen))| TracedPoint {
                place: PointInSet(place),
                id: PointId(point),
                ao: *ao,
                buried: flags & flag::BURIED != 0,
                seen: *seen > 0,
            })
    }

    /// Points of a chunk that clients have and that are out of view.
    pub(super) fn out_of_view(&self, chunk: &Chunk) -> impl Iterator<Item = PointId> + '_ {
        let first = chunk.first.index();
        let flags = &self.flags[first..first + chunk.points.len()];
        let points = (chunk.first.0..).zip(flags).filter(|(_, flags)| **flags & flag::SHOWN == flag::ACTIVE);
        points.map(|(point, _)| PointId(point))
    }

    /// AO of a point as last traced, not rounded; nothing where the field does not keep it.
    #[cfg(any(test, feature = "testing"))]
    pub(super) fn exact(&self, point: PointId) -> Option<f32> {
        self.exact.get(point.index()).copied()
    }

    /// Bounds of a chunk in the world.
    pub(super) fn bounds(&self, world: &SceneBvh, chunk: &Chunk) -> Bounds {
        let known = chunk.world_bounds(world);
        known.unwrap_or_else(|| {
            Bounds::around(
                self.placed().in_world(world, chunk.instance, &chunk.points).map(|(position, _)| position),
            )
        })
    }

    /// Marks which points are in view and which are no longer fresh.
    pub(super) fn mark(
        &mut self,
        world: &SceneBvh,
        points: &ScenePoints,
        (views, first): (Option<&Views>, bool),
        bias: f32,
        reach: f32,
    ) {
        let quality = self.quality;
        let dirty = DirtyRegions {
            swept: world.changes().iter().filter_map(InstanceChange::swept).collect(),
            detached: world.changes().iter().any(|change| matches!(change, InstanceChange::Detached(_))),
            bias,
            reach,
        };
        let (parts, rest) = self.split();
        parts.into_par_iter().for_each(|mut part| {
            part.see(&rest, world, views);
            if let (Some(quality), Some(views)) = (quality, views) {
                let set = &points.sets()[world.scene().instances()[part.chunk.instance].rest().index()];
                if let Some(layout) = set.at_rest() {
                    part.choose_levels(&rest, world, &LevelChoice { views, quality, layout, first });
                }
            }
            part.invalidate(&rest, world, &dirty);
        });
    }

    /// Finds out which points in view a picture needs, and gives clients the blocks that have one: at most `most` more, those
    /// of coarse levels first.
    pub(super) fn look(&mut self, sight: &Sight<'_>, most: usize) {
        let (parts, places) = self.split();
        parts.into_par_iter().for_each(|mut part| sight.look(&mut part, &places));
        let mut needed: Vec<(u8, Range<usize>)> =
            self.chunks.iter().flat_map(|chunk| self.needed(chunk)).collect();
        needed.sort_by_key(|(level, points)| (*level, points.start));
        for (_, points) in needed.into_iter().take(most) {
            self.flags[points].iter_mut().for_each(|flags| *flags |= flag::ACTIVE);
        }
    }

    /// Returns the blocks of a chunk that clients do not have and of which a picture needs a point: level and point ids.
    fn needed(&self, chunk: &Chunk) -> impl Iterator<Item = (u8, Range<usize>)> {
        let points = chunk.first.index()..chunk.first.index() + chunk.points.len();
        points.clone().step_by(BLOCK_POINTS).zip(chunk.levels).filter_map(move |(first, level)| {
            let block = first..points.end.min(first + BLOCK_POINTS);
            let (flags, seen) = (&self.flags[block.clone()], &self.seen[block.clone()]);
            let is_needed = |(flags, seen): (&u8, &u8)| *seen > 0 && flags & flag::VISIBLE != 0;
            let missing = flags[0] & flag::ACTIVE == 0;
            (missing && flags.iter().zip(seen).any(is_needed)).then_some((level, block))
        })
    }

    /// Points of each chunk that are in view and whose AO may have changed; all in view unless `untouched` ones are left out.
    pub(super) fn stale(&self, untouched: bool) -> Vec<u32> {
        let mask = if untouched { flag::SHOWN | flag::FRESH } else { flag::SHOWN };
        let of_chunk = |chunk: &Chunk| {
            let first = chunk.first.index();
            let flags = &self.flags[first..first + chunk.points.len()];
            flags.iter().filter(|&&flags| flags & mask == flag::SHOWN).count() as u32
        };
        self.chunks.iter().map(of_chunk).collect()
    }

    /// Ends a frame: bytes that points remember of their rays, at most `limit`.
    pub(super) fn settle(&mut self, limit: usize) -> usize {
        hit_cache::settle(&mut self.memories, limit)
    }

    /// The field in parts that can be worked on side by side, and what they share.
    pub(super) fn split(&mut self) -> (Vec<FieldPart<'_>>, PointPlaces<'_>) {
        let mut parts = Vec::with_capacity(self.chunks.len());
        let (mut flags, mut ao) = (self.flags.as_mut_slice(), self.ao.as_mut_slice());
        let (mut exact, mut seen) = (self.exact.as_mut_slice(), self.seen.as_mut_slice());
        let mut dug = self.dug.as_mut_slice();
        for ((chunk, memory), wanted) in self.chunks.iter().zip(&mut self.memories).zip(&mut self.wanted) {
            let (head, tail) = flags.split_at_mut(chunk.points.len());
            let (bytes, others) = ao.split_at_mut(chunk.points.len());
            let (values, rest) = exact.split_at_mut(exact.len().min(chunk.points.len()));
            let (held, later) = seen.split_at_mut(chunk.points.len());
            let (known, unknown) = dug.split_at_mut(chunk.points.len());
            parts.push(FieldPart {
                chunk,
                flags: head,
                ao: bytes,
                exact: values,
                seen: held,
                dug: known,
                wanted,
                memory,
            });
            (flags, ao, exact, seen, dug) = (tail, others, rest, later, unknown);
        }
        (parts, PointPlaces { places: &self.places, shared: &self.shared, worlds: &self.worlds })
    }
}

/// Regions that changed since the last frame, and the distance within which they invalidate AO.
struct DirtyRegions<'a> {
    swept: Vec<&'a SweptBounds>,
    /// Whether some instance was moved out of a static batch.
    detached: bool,
    bias: f32,
    reach: f32,
}

impl Chunk {
    /// Bounds in the world, or nothing where they are not known.
    fn world_bounds(&self, world: &SceneBvh) -> Option<Bounds> {
        if world.is_still(self.instance) {
            return Some(self.bounds);
        }
        let deforming = world.scene().instances()[self.instance].motion() == Motion::Deforming;
        let at = world.placement(InstanceId(self.instance as u32));
        (!deforming).then(|| self.bounds.transformed(at.rotation, at.translation))
    }
}

impl FieldPart<'_> {
    /// Points in view.
    pub(super) fn visible(&self) -> u32 {
        self.flags.iter().filter(|&&flags| is_shown(flags)).count() as u32
    }

    /// Takes whole blocks into view or out of it, by whether the view asks for points as fine as theirs. In the first frame,
    /// the coarsest points count as in view wherever they are.
    fn choose_levels(&mut self, placed: &PointPlaces<'_>, world: &SceneBvh, choice: &LevelChoice<'_>) {
        let LevelChoice { views, quality, layout, first } = *choice;
        let present = world.is_present(self.chunk.instance);
        let mut pixels = [f32::INFINITY; CHUNK_BLOCKS];
        // A few points tell how near a block is, but all that are in view if it is at the edge of the view.
        let visible = self.flags.iter().filter(|flags| **flags & flag::VISIBLE != 0).count();
        let step = match visible {
            0 => self.flags.len(),
            _ if visible == self.flags.len() => PIXEL_STEP,
            _ => 1,
        };
        for (index, (place, normal)) in
            placed.in_world(world, self.chunk.instance, &self.chunk.points).enumerate().step_by(step)
        {
            if self.flags[index] & flag::VISIBLE != 0 {
                let pixel = &mut pixels[index / BLOCK_POINTS];
                *pixel = pixel.min(views.pixel(place, normal));
            }
        }
        for ((block, flags), pixel) in self.flags.chunks_mut(BLOCK_POINTS).enumerate().zip(pixels) {
            let level = self.chunk.levels[block];
            let held = if flags[0] & flag::ACTIVE != 0 { HOLD_FACTOR } else { 1.0 };
            let wanted = layout.level_within(PIXEL_FACTOR * quality * pixel);
            let fine_enough =
                pixel.is_finite() && level <= layout.level_within(held * PIXEL_FACTOR * quality * pixel);
            let any = present && (first && level == 0 || fine_enough);
            flags.iter_mut().for_each(|flags| set(flags, flag::VISIBLE, any));
            self.wanted[block] = wanted;
        }
    }

    /// Returns the radius of a client's fit around a point, metres: that of the level for which the view asks.
    pub(super) fn level_radius(&self, set: &PointSet, index: usize) -> f32 {
        let level = self.wanted[index / BLOCK_POINTS];
        set.at_rest().map_or_else(|| REACH_RADII * set.radius(), |layout| layout.level_radius(level))
    }

    /// Marks the points in view.
    fn see(&mut self, placed: &PointPlaces<'_>, world: &SceneBvh, views: Option<&Views>) {
        let present = world.is_present(self.chunk.instance);
        let overlap = match (views, self.chunk.world_bounds(world)) {
            _ if !present => Overlap::Outside,
            (None, _) => Overlap::Inside,
            (Some(_), None) => Overlap::Partly,
            (Some(views), Some(bounds)) => {
                views.overlap((bounds.min() + bounds.max()) * 0.5, bounds.size().length() * 0.5)
            }
        };
        match (overlap, views) {
            (Overlap::Partly, Some(views)) => {
                for (flags, (position, _)) in
                    self.flags.iter_mut().zip(placed.in_world(world, self.chunk.instance, &self.chunk.points))
                {
                    set(flags, flag::VISIBLE, views.see(position));
                }
            }
            _ => {
                self.flags.iter_mut().for_each(|flags| set(flags, flag::VISIBLE, overlap == Overlap::Inside));
            }
        }
    }

    /// Marks points as stale whose AO may have changed: their instance moved, or swept bounds touch the ball that their
    /// rays reach.
    fn invalidate(&mut self, placed: &PointPlaces<'_>, world: &SceneBvh, dirty: &DirtyRegions<'_>) {
        let DirtyRegions { swept, detached, bias, reach } = dirty;
        match world.changes()[self.chunk.instance] {
            InstanceChange::Unchanged => {}
            InstanceChange::Moved(_) => {
                return self.flags.iter_mut().for_each(|flags| *flags &= !flag::FRESH);
            }
            InstanceChange::Deformed(_) | InstanceChange::Detached(_) => {
                self.memory.clear();
                return self.flags.iter_mut().for_each(|flags| *flags &= !(flag::FRESH | flag::ALONE));
            }
        }
        let around = self.chunk.world_bounds(world).map(|bounds| bounds.grown(bias + reach));
        let near: Vec<Bounds> = swept
            .iter()
            .filter(|swept| around.is_none_or(|around| around.touches(&swept.bounds)))
            .flat_map(|swept| swept.parts.iter().copied())
            .filter(|part| around.is_none_or(|around| around.touches(part)))
            .collect();
        if near.is_empty() {
            return;
        }
        // A point with nothing but the static batch in reach may have had an instance in reach that was detached from it.
        let kept = if *detached && world.is_still(self.chunk.instance) {
            self.memory.clear();
            !(flag::FRESH | flag::ALONE)
        } else {
            !flag::FRESH
        };
        for (flags, (position, normal)) in
            self.flags.iter_mut().zip(placed.in_world(world, self.chunk.instance, &self.chunk.points))
        {
            let origin = position + normal * *bias;
            if near.iter().any(|bounds| bounds.distance_squared(origin) <= reach * reach) {
                *flags &= kept;
            }
        }
    }
}

/// What levels are chosen by.
#[derive(Clone, Copy)]
struct LevelChoice<'a> {
    views: &'a Views,
    /// Pixels.
    quality: f32,
    layout: &'a SetLayout,
    /// Whether this is the first frame.
    first: bool,
}

/// Returns whether a point is in view and clients have it.
pub(super) fn is_shown(flags: u8) -> bool {
    flags & flag::SHOWN == flag::SHOWN
}

pub(super) fn set(flags: &mut u8, bit: u8, on: bool) {
    *flags = if on { *flags | bit } else { *flags & !bit };
}
