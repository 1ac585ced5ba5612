//! Skinned walkers. They share one body and one rest; each has its own joints.
//!
//! A standing foot has a fixed place on the floor, and the leg bends to reach it (two bones, law of cosines), along
//! any path.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::DURATION_S;
use super::model_builder::{ModelBuilder, about};
use super::solid::{Solid, sweep};
use crate::scene::mesh::SkinWeights;
use crate::scene::model::{MeshNode, Skin};

/// Height of the hip joints, metres.
const HIP_M: f64 = 0.86;
/// Largest height of a walking body's hips above their height at rest, because its ankles are off the floor.
const STRETCH_M: f64 = 0.03;
/// Length of thigh and shin, metres.
const BONE_M: f64 = 0.43;
/// Height of the ankle over the sole, metres.
const ANKLE_M: f64 = 0.08;
/// Distance of each foot's line from the middle of the body, metres.
const ASIDE_M: f64 = 0.1;
/// Fraction of a step's cycle in which the foot stands.
const STAND: f64 = 0.6;
/// Number of keys of an animation over the clip.
const KEYS: u32 = 450;

/// A joint: its parent, and its place in the body at rest (metres, y up, z ahead, +x is the left side).
struct Joint(Option<usize>, [f64; 3]);

/// The skeleton, left side first.
const JOINTS: [Joint; 19] = [
    Joint(None, [0.0, HIP_M + 0.06, 0.0]),                  // 0 hips
    Joint(Some(0), [0.0, 1.08, 0.0]),                       // 1 spine
    Joint(Some(1), [0.0, 1.26, 0.0]),                       // 2 chest
    Joint(Some(2), [0.0, 1.45, 0.0]),                       // 3 neck
    Joint(Some(3), [0.0, 1.53, 0.01]),                      // 4 head
    Joint(Some(2), [0.08, 1.4, 0.0]),                       // 5 left collar
    Joint(Some(5), [0.2, 1.38, 0.0]),                       // 6 left shoulder
    Joint(Some(6), [0.23, 1.1, -0.01]),                     // 7 left elbow
    Joint(Some(7), [0.24, 0.85, 0.0]),                      // 8 left hand
    Joint(Some(2), [-0.08, 1.4, 0.0]),                      // 9 right collar
    Joint(Some(9), [-0.2, 1.38, 0.0]),                      // 10 right shoulder
    Joint(Some(10), [-0.23, 1.1, -0.01]),                   // 11 right elbow
    Joint(Some(11), [-0.24, 0.85, 0.0]),                    // 12 right hand
    Joint(Some(0), [ASIDE_M, HIP_M, 0.0]),                  // 13 left hip
    Joint(Some(13), [ASIDE_M, HIP_M - BONE_M, 0.0]),        // 14 left knee
    Joint(Some(14), [ASIDE_M, HIP_M - 2.0 * BONE_M, 0.0]),  // 15 left ankle
    Joint(Some(0), [-ASIDE_M, HIP_M, 0.0]),                 // 16 right hip
    Joint(Some(16), [-ASIDE_M, HIP_M - BONE_M, 0.0]),       // 17 right knee
    Joint(Some(17), [-ASIDE_M, HIP_M - 2.0 * BONE_M, 0.0]), // 18 right ankle
];

/// Returns the place of a joint at rest. Legs are straight, so the soles are below the floor until a pose bends them.
fn rest(joint: usize) -> DVec3 {
    DVec3::from_array(JOINTS[joint].1)
}

/// A closed elliptical path around a centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track {
    pub(super) centre: DVec3,
    pub(super) half_x: f64,
    pub(super) half_z: f64,
    /// Position at the start of the clip as a fraction of a lap.
    pub(super) start: f64,
    /// Number of laps over the clip: 1 or -1.
    pub(super) laps: f64,
}

impl Track {
    /// Returns the place on the floor and the heading (radians about y, 0 along z) at a given time.
    fn at(&self, time_s: f64) -> (DVec3, f64) {
        let angle = TAU * (self.start + self.laps * time_s / DURATION_S);
        let (s, c) = (libm::sin(angle), libm::cos(angle));
        let place = self.centre + DVec3::new(self.half_x * c, 0.0, self.half_z * s);
        (place, libm::atan2(-self.half_x * s * self.laps, self.half_z * c * self.laps))
    }

    /// Returns the length of a lap in metres (Ramanujan's approximation).
    fn length(&self) -> f64 {
        let (a, b) = (self.half_x, self.half_z);
        PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt())
    }
}

/// The mesh that all walkers share.
pub(super) struct WalkerMesh {
    mesh: usize,
}

impl WalkerMesh {
    /// Adds the mesh to the model.
    pub(super) fn new(builder: &mut ModelBuilder) -> Option<Self> {
        let (mut whole, mut bound) = (Solid::default(), Vec::new());
        for (part, chain) in body() {
            bound.extend(part.positions().iter().map(|p| influences(p.as_dvec3(), &chain)));
            whole.add(&part, DAffine3::IDENTITY);
        }
        let mut raw = whole.raw("walker");
        let (joints, weights) = bound.into_iter().unzip();
        raw.skin = Some(SkinWeights { sets: 1, joints, weights });
        let plain = builder.plain;
        builder.model.add_mesh(raw, plain).map(|mesh| Self { mesh })
    }

    /// Adds a walker on a track.
    pub(super) fn walk(&self, builder: &mut ModelBuilder, track: &Track) {
        let gait = Gait::new(*track);
        let root = builder.add_node(None, 0.0, 0.0, 0.0);
        builder.animate_translation(root, KEYS, |time| track.at(time).0);
        builder.animate_rotation(root, KEYS, |time| about(DVec3::Y, track.at(time).1));
        let mut nodes = Vec::new();
        for (i, Joint(parent, _)) in JOINTS.iter().enumerate() {
            let place = rest(i) - parent.map_or(DVec3::ZERO, rest);
            let node = builder.add_node(Some(parent.map_or(root, |p| nodes[p])), place.x, place.y, place.z);
            nodes.push(node);
        }
        for (i, node) in nodes.iter().enumerate() {
            builder.animate_rotation(*node, KEYS, |time| gait.rotation(i, time));
        }
        builder.animate_translation(nodes[0], KEYS, |time| rest(0) + DVec3::Y * gait.bob(time));
        let inverse_bind = (0..JOINTS.len()).map(|i| DAffine3::from_translation(-rest(i))).collect();
        builder.model.skins.push(Skin { joints: nodes, inverse_bind });
        let skin = Some(builder.model.skins.len() - 1);
        let name = format!("walker {}", builder.model.skins.len());
        builder.model.mesh_nodes.push(MeshNode {
            name,
            node: root,
            mesh: self.mesh,
            skin,
            weights: Vec::new(),
        });
    }
}

/// Steps of one walker.
struct Gait {
    track: Track,
    /// Length of a cycle (two steps), seconds.
    cycle_s: f64,
    phase: f64,
}

impl Gait {
    fn new(track: Track) -> Self {
        // A whole number of cycles of about one metre each closes the clip.
        let cycles = (track.length() / 0.9).round().max(1.0);
        Self { track, cycle_s: DURATION_S / cycles, phase: (track.start * 7.31).rem_euclid(1.0) }
    }

    /// Returns the number of cycles since the foot's first stand began; `side` 0 is left, 1 right.
    fn progress(&self, side: usize, time_s: f64) -> f64 {
        time_s / self.cycle_s + self.phase + 0.5 * side as f64
    }

    /// Returns the height of the hips above their height at rest, metres.
    fn bob(&self, time_s: f64) -> f64 {
        STRETCH_M + 0.012 * libm::cos(2.0 * TAU * (self.progress(0, time_s) - 0.3)) - 0.012
    }

    /// Returns the place and heading of a foot's ankle in the world during its `stand`-th stand.
    fn planted(&self, side: usize, stand: f64) -> (DVec3, f64) {
        let middle = (stand + STAND / 2.0 - self.phase - 0.5 * side as f64) * self.cycle_s;
        let (place, heading) = self.track.at(middle);
        let aside = if side == 0 { ASIDE_M } else { -ASIDE_M };
        let across = about(DVec3::Y, heading) * DVec3::X;
        (place + across * aside + DVec3::Y * ANKLE_M, heading)
    }

    /// Returns an ankle in the world: its place, its heading, and the angle of its toes upwards (radians).
    fn ankle(&self, side: usize, time_s: f64) -> (DVec3, f64, f64) {
        let progress = self.progress(side, time_s);
        let (stand, share) = (progress.floor(), progress - progress.floor());
        let (from, heading) = self.planted(side, stand);
        if share < STAND {
            return (from, heading, 0.0);
        }
        let (to, next) = self.planted(side, stand + 1.0);
        let swing = (share - STAND) / (1.0 - STAND);
        let ease = swing * swing * (3.0 - 2.0 * swing);
        let lift = libm::sin(PI * swing);
        let turn = (next - heading + PI).rem_euclid(TAU) - PI;
        let toes = -0.45 * libm::sin(TAU * swing) * (1.0 - 0.4 * swing);
        (
            from.lerp(to, ease) + DVec3::Y * (0.1 * lift),
            heading + turn * ease,
            -toes.abs() * (0.5 - swing).signum(),
        )
    }

    /// Returns the rotation of a joint relative to its parent.
    fn rotation(&self, joint: usize, time_s: f64) -> DQuat {
        let wave = |shift: f64| libm::sin(TAU * (self.progress(0, time_s) + shift));
        match joint {
            1 | 2 => about(DVec3::Y, 0.05 * wave(0.2)) * about(DVec3::X, 0.03),
            3 => about(DVec3::Y, -0.1 * wave(0.2)),
            // Arms swing against the legs.
            6 => about(DVec3::X, 0.42 * wave(0.45)) * about(DVec3::Z, 0.06),
            10 => about(DVec3::X, -0.42 * wave(0.45)) * about(DVec3::Z, -0.06),
            7 => about(DVec3::X, -0.4 - 0.2 * wave(0.2)),
            11 => about(DVec3::X, -0.4 + 0.2 * wave(0.2)),
            13..=15 => self.leg(0, time_s)[joint - 13],
            16..=18 => self.leg(1, time_s)[joint - 16],
            _ => DQuat::IDENTITY,
        }
    }

    /// Returns the rotations of hip, knee and ankle that bring the ankle to its place.
    fn leg(&self, side: usize, time_s: f64) -> [DQuat; 3] {
        let (place, heading) = self.track.at(time_s);
        let (ankle, foot_heading, toes) = self.ankle(side, time_s);
        let back = about(DVec3::Y, -heading);
        let hip = rest(13 + 3 * side) + DVec3::Y * self.bob(time_s);
        let reach = back * (ankle - place) - hip;
        let distance = reach.length().clamp(0.1, 2.0 * BONE_M - 1e-4);
        let down = reach / reach.length();
        let foot = about(DVec3::Y, foot_heading - heading) * about(DVec3::X, -toes);
        // The knee bends in the direction of the foot.
        let side_axis = (foot * DVec3::X).cross(down).cross(down).normalize() * -1.0;
        let open = libm::acos(distance / (2.0 * BONE_M));
        let thigh = bone(about(side_axis, -open) * down, side_axis);
        let shin = bone(about(side_axis, open) * down, side_axis);
        [thigh, thigh.conjugate() * shin, shin.conjugate() * foot]
    }
}

/// Returns the rotation of a bone that hangs down (-y) at rest, from its direction and its sideways axis.
fn bone(direction: DVec3, side_axis: DVec3) -> DQuat {
    let up = -direction;
    DQuat::from_mat3(&DMat3::from_cols(side_axis, up, side_axis.cross(up)))
}

/// Returns a closed, rounded limb along a path; `radii` returns the half widths (x, z) along it.
fn limb(path: &[DVec3], rings: usize, radii: impl Fn(f64) -> (f64, f64)) -> Solid {
    let last = (path.len() - 1) as f64;
    let point = |t: f64| {
        let i = ((t * last) as usize).min(path.len() - 2);
        path[i].lerp(path[i + 1], t * last - i as f64)
    };
    // The rings are closer together at the rounded ends.
    let share = |k: usize| 0.5 - 0.5 * libm::cos(PI * k as f64 / rings as f64);
    let centres: Vec<DVec3> = (0..=rings).map(|k| point(share(k))).collect();
    let shape = |s: f64| {
        let t = share((s * rings as f64).round() as usize);
        let (a, b) = radii(t);
        let end = (t.min(1.0 - t) / 0.07).min(1.0);
        let round = (1.0 - (1.0 - end) * (1.0 - end)).max(0.0).sqrt().max(0.02);
        (a * round, b * round)
    };
    Solid::loft(&sweep(&centres, 10, shape))
}

/// Returns the undeformed body, part by part, each with the chain of joints that it follows from its root on.
fn body() -> Vec<(Solid, Vec<usize>)> {
    let mut parts = Vec::new();
    let up = |y: f64| DVec3::new(0.0, y, 0.0);
    let torso = |t: f64| {
        let waist = 1.0 - 0.22 * libm::sin(PI * (t * 1.25).min(1.0));
        (0.165 * waist + 0.03 * t, 0.115 * waist + 0.01 * t)
    };
    let spine = || vec![0, 1, 2, 3, 4];
    parts.push((limb(&[up(0.8), up(1.0), up(1.25), up(1.46)], 13, torso), spine()));
    parts.push((limb(&[up(1.42), up(1.58)], 4, |_| (0.055, 0.055)), spine()));
    let mut head = Solid::default();
    head.add_at(&Solid::ball(2, |d| 0.115 * (1.0 + 0.12 * d.y.abs() - 0.08 * d.x.abs())), 0.0, 1.64, 0.015);
    head.add_at(&Solid::block(DVec3::new(0.075, 0.022, 0.03), 0.01), 0.0, 1.66, 0.11);
    parts.push((head, vec![4]));
    for side in [0, 1] {
        let (shoulder, hip) = (6 + 4 * side, 13 + 3 * side);
        let arm =
            [rest(shoulder), rest(shoulder + 1), rest(shoulder + 2), rest(shoulder + 2) - DVec3::Y * 0.12];
        let joints = vec![2, shoulder, shoulder + 1, shoulder + 2];
        parts.push((limb(&arm, 13, |t| (0.055 - 0.02 * t, 0.055 - 0.016 * t)), joints));
        let mut cap = Solid::default();
        cap.add(&Solid::ball(1, |_| 0.068), DAffine3::from_translation(rest(shoulder)));
        parts.push((cap, vec![shoulder]));
        let ankle = rest(hip + 2);
        let leg = [rest(hip) + DVec3::Y * 0.06, rest(hip + 1), ankle];
        parts.push((
            limb(&leg, 15, |t| (0.088 - 0.038 * t, 0.095 - 0.04 * t)),
            vec![0, hip, hip + 1, hip + 2],
        ));
        let sole = |z: f64| DVec3::new(ankle.x, ankle.y - ANKLE_M + 0.045, z);
        let foot =
            limb(&[sole(-0.09), sole(0.03), sole(0.19)], 8, |t| (0.046 + 0.008 * t, 0.044 - 0.006 * t));
        parts.push((foot, vec![hip + 2]));
    }
    parts
}

/// Returns the joints (at most four) of a chain that a point follows, with weights. The influence changes from one
/// joint to the next within 6 cm of the next one's height. Legs and arms run down, the spine runs up.
fn influences(p: DVec3, joints: &[usize]) -> ([u16; 4], [f32; 4]) {
    const BLEND_M: f64 = 0.06;
    let upward = joints.contains(&1);
    let beyond = |joint: usize| {
        let over = if upward { p.y - rest(joint).y } else { rest(joint).y + 0.02 - p.y };
        let t = (over / (2.0 * BLEND_M) + 0.5).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let mut left = 1.0;
    let mut slots: Vec<(usize, f64)> = Vec::new();
    for &joint in joints.iter().skip(1).rev() {
        let share = beyond(joint) * left;
        left -= share;
        slots.push((joint, share));
    }
    slots.push((joints[0], left));
    slots.sort_by(|a, b| b.1.total_cmp(&a.1));
    slots.truncate(4);
    let total: f64 = slots.iter().map(|slot| slot.1).sum();
    let mut out = ([0; 4], [0.0; 4]);
    for (i, (joint, share)) in slots.into_iter().enumerate() {
        (out.0[i], out.1[i]) = (joint as u16, (share / total) as f32);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track() -> Track {
        Track { centre: DVec3::new(1.0, 0.0, -2.0), half_x: 2.0, half_z: 1.2, start: 0.3, laps: -1.0 }
    }

    /// Returns the world place of an ankle, computed joint by joint.
    fn forward(gait: &Gait, side: usize, time: f64) -> DVec3 {
        let (place, heading) = gait.track.at(time);
        let mut at = rest(13 + 3 * side) + DVec3::Y * gait.bob(time);
        let mut turned = DQuat::IDENTITY;
        for joint in 13 + 3 * side..15 + 3 * side {
            turned *= gait.rotation(joint, time);
            at += turned * (rest(joint + 1) - rest(joint));
        }
        place + about(DVec3::Y, heading) * at
    }

    #[test]
    fn standing_feet_stay_where_they_are() {
        let gait = Gait::new(track());
        for side in 0..2 {
            for i in 0..600 {
                let time = f64::from(i) * 0.025;
                let (wanted, _, _) = gait.ankle(side, time);
                let found = forward(&gait, side, time);
                assert!(found.distance(wanted) < 2e-3, "side {side} at {time} s: {found} not {wanted}");
                assert!(wanted.y >= ANKLE_M - 1e-9);
            }
        }
    }

    #[test]
    fn the_walk_closes() {
        let gait = Gait::new(track());
        for joint in 0..JOINTS.len() {
            let (a, b) = (gait.rotation(joint, 0.0), gait.rotation(joint, DURATION_S));
            assert!(a.dot(b).abs() > 1.0 - 1e-9, "joint {joint}");
        }
    }

    #[test]
    fn every_vertex_follows_with_whole_weight() {
        for (part, chain) in body() {
            for p in part.positions() {
                let (_, weights) = influences(p.as_dvec3(), &chain);
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            }
        }
        let shin = DVec3::new(0.1, 0.2, 0.0);
        assert_eq!(influences(shin, &[0, 13, 14, 15]), ([14, 15, 13, 0], [1.0, 0.0, 0.0, 0.0]));
    }
}
