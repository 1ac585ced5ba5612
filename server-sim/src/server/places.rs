//! Where the points of instances are.

use std::ops::Range;

use glam::Vec3;

use crate::ao::RayFrame;
use crate::points::{PlacedPoint, PointInSet};
use crate::scene::InstanceId;
use crate::world::SceneBvh;

/// Points of an instance in its local space.
#[derive(Debug)]
pub(super) enum Places {
    /// The set's, by number.
    Shared(usize),
    /// Its own, in the current pose.
    Own(Vec<PlacedPoint>),
}

/// Where the points are, to be read while the rest of the field is written.
#[derive(Clone, Copy)]
pub(super) struct PointPlaces<'a> {
    pub(super) places: &'a [Places],
    pub(super) shared: &'a [Vec<PlacedPoint>],
    pub(super) worlds: &'a [Vec<PlacedPoint>],
}

impl<'a> PointPlaces<'a> {
    /// Points of an instance in its local space.
    pub(super) fn local(&self, instance: usize) -> &'a [PlacedPoint] {
        match &self.places[instance] {
            Places::Shared(set) => &self.shared[*set],
            Places::Own(own) => own,
        }
    }

    /// Points of an instance in the space of its body: the world for instances in a static batch, else its own.
    pub(super) fn in_body_space(&self, instance: usize) -> &'a [PlacedPoint] {
        if self.worlds[instance].is_empty() { self.local(instance) } else { &self.worlds[instance] }
    }

    /// Returns the frame of a point's rays.
    pub(super) fn ray_frame(&self, world: &SceneBvh, instance: usize, point: PointInSet) -> RayFrame {
        let PlacedPoint { position, normal, edge } = self.in_body_space(instance)[point.index()];
        RayFrame { body: world.body(instance), position, normal, edge }
    }

    /// World positions and normals of some points of an instance.
    pub(super) fn in_world(
        &self,
        world: &SceneBvh,
        instance: usize,
        points: &Range<usize>,
    ) -> impl Iterator<Item = (Vec3, Vec3)> + 'a {
        let still = world.is_still(instance);
        let at = world.placement(InstanceId(instance as u32));
        self.in_body_space(instance)[points.clone()].iter().map(move |point| {
            if still {
                (point.position, point.normal)
            } else {
                (at.point(point.position), at.direction(point.normal))
            }
        })
    }
}
