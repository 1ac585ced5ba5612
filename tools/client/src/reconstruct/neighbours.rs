//! The points around a fragment: the 2 x 2 x 2 cells nearest to it, unpacked (paper, section 3.5).

use glam::{Mat3, Quat, Vec3};
use psao_codec::paper::{Grid, POINTS_PER_CELL, State};

/// Points of a group, which are weighted together: as many as a wide vector register holds.
pub(super) const LANES: usize = 8;
/// Most groups of a neighbourhood: 8 cells of 7 points are 56 (paper, section 3.5).
const GROUPS: usize = (8 * POINTS_PER_CELL).div_ceil(LANES);

/// Eight points side by side, in the local space of their instance. Lanes without a point lie infinitely far away.
#[derive(Clone, Copy)]
pub(super) struct Group {
    pub(super) position: [[f32; LANES]; 3],
    pub(super) normal: [[f32; LANES]; 3],
    pub(super) ao: [f32; LANES],
}

impl Group {
    pub(super) const EMPTY: Self =
        Self { position: [[f32::INFINITY; LANES]; 3], normal: [[0.0; LANES]; 3], ao: [0.0; LANES] };

    pub(super) fn set(&mut self, lane: usize, position: Vec3, normal: Vec3, ao: f32) {
        for axis in 0..3 {
            self.position[axis][lane] = position[axis];
            self.normal[axis][lane] = normal[axis];
        }
        self.ao[lane] = ao;
    }
}

/// What it takes to bring a fragment into an instance's local space and to find its cells there.
pub(super) struct InstanceSpace {
    instance: u32,
    to_local: Mat3,
    translation: Vec3,
    grid: Grid,
    kernel_radius: f32,
}

impl InstanceSpace {
    /// The spaces of all instances of `state`, by the poses that the server sent last: points are right
    /// relative to the surface even when client and server do not run in lockstep (paper, section 3.5).
    pub(super) fn all(state: &State) -> Vec<Self> {
        let layouts = state.layout().instances().iter();
        let poses = state.poses().iter();
        layouts
            .zip(poses)
            .zip(0u32..)
            .map(|((layout, pose), instance)| {
                let rotation = Quat::from_array(pose.rotation);
                Self {
                    instance,
                    to_local: Mat3::from_quat(rotation).transpose(),
                    translation: Vec3::from(pose.translation),
                    grid: layout.grid,
                    kernel_radius: layout.kernel_radius,
                }
            })
            .collect()
    }

    /// `r` of Eq. 2 in metres.
    pub(super) fn kernel_radius(&self) -> f32 {
        self.kernel_radius
    }

    /// A world position in the instance's local space: the inverse of a rigid transform.
    pub(super) fn local_point(&self, world: Vec3) -> Vec3 {
        self.to_local * (world - self.translation)
    }

    /// A world direction in the instance's local space.
    pub(super) fn local_vector(&self, world: Vec3) -> Vec3 {
        self.to_local * world
    }

    /// The lowest of the 2 x 2 x 2 cells whose centres are nearest to a local position: the cells
    /// `base .. base + 1` on each axis. May lie outside the grid. `None` for a position that is not finite.
    pub(super) fn base(&self, local: Vec3) -> Option<[i64; 3]> {
        // The grid shifted by half a cell: between two cell centres the pair of cells stays the same.
        let shifted = (local - Vec3::from(self.grid.origin())) / self.grid.edge() - 0.5;
        shifted.is_finite().then(|| shifted.floor().to_array().map(|axis| axis as i64))
    }
}

/// The unpacked points of the 2 x 2 x 2 cells from one base cell on.
#[derive(Clone)]
struct Neighbourhood {
    key: Option<(u32, [i64; 3])>,
    count: usize,
    groups: [Group; GROUPS],
}

impl Neighbourhood {
    const EMPTY: Self = Self { key: None, count: 0, groups: [Group::EMPTY; GROUPS] };

    fn fill(&mut self, state: &State, space: &InstanceSpace, base: [i64; 3]) {
        *self = Self { key: Some((space.instance, base)), ..Self::EMPTY };
        for step in 0..8_i64 {
            let wanted = [base[0] + (step & 1), base[1] + (step >> 1 & 1), base[2] + (step >> 2)];
            let Some(cell) = inside(wanted, space.grid.dims()) else { continue };
            let Some(found) = state.lookup(space.instance, cell) else { continue };
            let corner = Vec3::from(space.grid.corner(cell));
            for point in found.points(state.layout().format()) {
                let position = corner + Vec3::from(point.frac) * space.grid.edge();
                let group = &mut self.groups[self.count / LANES];
                group.set(self.count % LANES, position, point.normal.into(), point.accessibility());
                self.count += 1;
            }
        }
    }
}

/// Neighbourhoods that were needed last. Fragments near each other mostly share theirs, so unpacking is rare.
pub(super) struct Neighbours {
    slots: Vec<Neighbourhood>,
}

impl Neighbours {
    /// Slots: neighbourhoods that touch, whose bases differ by one, never share a slot, nor do two instances that
    /// follow each other.
    const SLOTS: usize = 16;

    pub(super) fn new() -> Self {
        Self { slots: vec![Neighbourhood::EMPTY; Self::SLOTS] }
    }

    /// The points of the cells from `base` on, eight at a time.
    pub(super) fn of(&mut self, state: &State, space: &InstanceSpace, base: [i64; 3]) -> &[Group] {
        let odd = base.map(|axis| (axis & 1) as usize);
        let slot = odd[0] | odd[1] << 1 | odd[2] << 2 | (space.instance as usize & 1) << 3;
        let slot = &mut self.slots[slot];
        if slot.key != Some((space.instance, base)) {
            slot.fill(state, space, base);
        }
        &slot.groups[..slot.count.div_ceil(LANES)]
    }
}

/// `wanted` as a cell of a grid of `dims` cells; `None` outside.
fn inside(wanted: [i64; 3], dims: [u32; 3]) -> Option<[u32; 3]> {
    let mut cell = [0; 3];
    for axis in 0..3 {
        cell[axis] = u32::try_from(wanted[axis]).ok().filter(|&c| c < dims[axis])?;
    }
    Some(cell)
}
