//! `robot-lab`: large flat walls and floor, railings, pipes, workbenches, robot arms and two dozen skinned walkers.
//! It is the counterpart of the paper's *Robot Lab* (section 4).

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DVec3};

use super::model_builder::{ModelBuilder, about, camera, swing};
use super::solid::{Solid, at, turn};
use super::walker::{Track, WalkerMesh};
use super::{BuiltinScene, DURATION_S, noise};

/// Half the room's length (x) and width (z), and its height, metres.
const HALF_X: f64 = 5.8;
const HALF_Z: f64 = 4.3;
const HEIGHT: f64 = 2.7;

/// Builds the scene.
pub(super) fn build() -> BuiltinScene {
    let mut builder = ModelBuilder::new();
    let plain = builder.plain;
    builder.add_static("room", room(), plain);
    builder.add_static("pipes", pipes(), plain);
    builder.add_static("railing", railing(), plain);
    builder.add_static("island", island(), plain);
    benches(&mut builder);
    let links = Links::new(&mut builder);
    for (i, (x, z, heading)) in
        [(-0.95, 0.0, 0.4), (0.95, 0.0, 2.2), (-5.35, 0.7, 1.57), (-5.35, -0.7, 1.57), (5.35, 0.0, -1.57)]
            .into_iter()
            .enumerate()
    {
        let y = if i < 2 { 0.3 } else { 0.0 };
        links.arm(&mut builder, i as i32, DVec3::new(x, y, z), heading);
    }
    walkers(&mut builder);
    let keys = [
        (0.0, [5.1, 2.3, 3.7], [0.0, 0.7, -0.4]),
        (3.75, [2.2, 2.0, 3.9], [-0.6, 0.8, -0.6]),
        (7.5, [-3.6, 2.2, 3.8], [0.0, 0.8, -0.6]),
        (11.25, [1.6, 2.4, 4.0], [0.6, 0.6, -0.6]),
        (DURATION_S, [5.1, 2.3, 3.7], [0.0, 0.7, -0.4]),
    ];
    BuiltinScene { model: builder.model, ao_radius_m: 0.6, camera: camera(62.0, &keys) }
}

/// Floor and walls (intentionally of two triangles each), skirting, wall panels and pilasters.
fn room() -> Solid {
    let mut solid = Solid::default();
    let floor = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
        .map(|(x, z)| DVec3::new(x * HALF_X, 0.0, z * HALF_Z));
    solid.polygon(&floor);
    for i in 0..4 {
        let (a, b) = (floor[i], floor[(i + 1) % 4]);
        let up = DVec3::Y * HEIGHT;
        solid.polygon(&[b, a, a + up, b + up]);
    }
    for side in [-1.0, 1.0] {
        solid.add_at(&Solid::block(DVec3::new(HALF_X, 0.05, 0.02), 0.01), 0.0, 0.05, side * (HALF_Z - 0.02));
        solid.add_at(&Solid::block(DVec3::new(0.02, 0.05, HALF_Z), 0.01), side * (HALF_X - 0.02), 0.05, 0.0);
        for i in 0..4 {
            let x = (f64::from(i) - 1.5) * 3.1;
            solid.add_at(
                &Solid::block(DVec3::new(0.09, HEIGHT / 2.0, 0.07), 0.02),
                x,
                HEIGHT / 2.0,
                side * (HALF_Z - 0.06),
            );
        }
        for i in 0..4 {
            let z = (f64::from(i) - 1.5) * 2.1;
            let panel = Solid::block(DVec3::new(0.025, 0.5, 0.9), 0.015);
            solid.add_at(&panel, side * (HALF_X - 0.03), 1.9, z);
        }
    }
    // A control cabinet with vents, and a door frame.
    for (x, z) in [(3.6, -HALF_Z + 0.28), (4.3, -HALF_Z + 0.28), (-5.3, -HALF_Z + 0.28)] {
        solid.add_at(&Solid::block(DVec3::new(0.32, 0.95, 0.24), 0.02), x, 0.97, z);
        for k in 0..8 {
            solid.add_at(
                &Solid::block(DVec3::new(0.2, 0.012, 0.015), 0.004),
                x,
                1.35 + 0.05 * f64::from(k),
                z + 0.25,
            );
        }
    }
    for x in [-0.65, 0.65] {
        solid.add_at(&Solid::block(DVec3::new(0.07, 1.1, 0.09), 0.02), x - 2.2, 1.1, HALF_Z - 0.08);
    }
    solid.add_at(&Solid::block(DVec3::new(0.72, 0.08, 0.09), 0.02), -2.2, 2.26, HALF_Z - 0.08);
    solid
}

/// Pipes along the walls with bends, flanges and brackets, and a rack of thin tubes.
fn pipes() -> Solid {
    let mut solid = Solid::default();
    let bend = |corners: &[DVec3], radius: f64| {
        // Quarter circles join straight runs.
        let mut path = vec![corners[0]];
        for w in corners.windows(3) {
            let (back, on) = ((w[0] - w[1]).normalize() * radius, (w[2] - w[1]).normalize() * radius);
            path.extend(
                (0..=6)
                    .map(|k| PI / 2.0 * f64::from(k) / 6.0)
                    .map(|a| w[1] + back * (1.0 - libm::sin(a)) + on * (1.0 - libm::cos(a))),
            );
        }
        path.push(corners[corners.len() - 1]);
        path
    };
    let (x, z) = (HALF_X - 0.22, HALF_Z - 0.2);
    for (i, radius) in [0.07, 0.05, 0.035].into_iter().enumerate() {
        let y = 2.5 - 0.2 * i as f64;
        let corners = [
            DVec3::new(-x, 0.0, z),
            DVec3::new(-x, y, z),
            DVec3::new(-x, y, -z),
            DVec3::new(x, y, -z),
            DVec3::new(x, y, z),
        ]
        .map(|c| c + DVec3::new(0.13 * i as f64 * -c.x.signum(), 0.0, 0.05 * i as f64));
        solid.add(&Solid::pipe(&bend(&corners, 0.25), radius, 14), DAffine3::IDENTITY);
        for k in 0..7 {
            let flange = Solid::lathe(
                &[&[(radius, -0.03), (radius + 0.04, -0.02), (radius + 0.04, 0.02), (radius, 0.03)]],
                14,
            );
            let along = (f64::from(k) - 3.0) * 1.5;
            solid.add(&flange, at(turn(2, PI / 2.0), along, y, -z + 0.05 * i as f64));
            solid.add_at(&Solid::block(DVec3::new(0.02, 0.02, 0.14), 0.005), along + 0.3, y, -z - 0.05);
        }
    }
    for i in 0..9 {
        let dx = 0.075 * f64::from(i);
        let corners = [
            DVec3::new(1.9 + dx, 0.0, -HALF_Z + 0.12),
            DVec3::new(1.9 + dx, 1.2 + dx, -HALF_Z + 0.12),
            DVec3::new(3.2, 1.2 + dx, -HALF_Z + 0.12),
        ];
        solid.add(&Solid::pipe(&bend(&corners, 0.12), 0.025, 8), DAffine3::IDENTITY);
    }
    solid
}

/// A railing around the island.
fn railing() -> Solid {
    let mut solid = Solid::default();
    let (a, b) = (1.95, 0.95);
    let corners = [(-a, -b), (a, -b), (a, b), (-a, b)];
    for i in 0..4 {
        let ((x, z), (u, w)) = (corners[i], corners[(i + 1) % 4]);
        let (from, to) = (DVec3::new(x, 0.0, z), DVec3::new(u, 0.0, w));
        let posts = ((to - from).length() / 0.65).round() as i32;
        for k in 0..posts {
            let foot = from.lerp(to, f64::from(k) / f64::from(posts));
            solid.add(
                &Solid::pipe(&[foot, foot + DVec3::Y * 0.5, foot + DVec3::Y], 0.022, 10),
                DAffine3::IDENTITY,
            );
            let plate = Solid::lathe(&[&[(0.06, 0.0), (0.06, 0.012)], &[(0.06, 0.012), (0.022, 0.02)]], 12);
            solid.add_at(&plate, foot.x, 0.0, foot.z);
        }
        for y in [0.35, 0.68, 1.0] {
            let up = DVec3::Y * y;
            let radius = if y == 1.0 { 0.026 } else { 0.014 };
            solid.add(
                &Solid::pipe(&[from + up, from.lerp(to, 0.5) + up, to + up], radius, 10),
                DAffine3::IDENTITY,
            );
        }
    }
    solid
}

/// The platform in the middle, with a workpiece on it.
fn island() -> Solid {
    let mut solid = Solid::default();
    solid.add_at(&Solid::block(DVec3::new(1.75, 0.06, 0.78), 0.02), 0.0, 0.06, 0.0);
    solid.add_at(&Solid::block(DVec3::new(1.6, 0.09, 0.65), 0.02), 0.0, 0.21, 0.0);
    solid.add_at(&Solid::block(DVec3::new(0.32, 0.2, 0.3), 0.02), 0.0, 0.5, 0.0);
    let gear = Solid::turned(
        &[
            &[(0.0, 0.0), (0.2, 0.0)],
            &[(0.2, 0.0), (0.2, 0.08)],
            &[(0.2, 0.08), (0.07, 0.08)],
            &[(0.07, 0.08), (0.07, 0.16)],
            &[(0.07, 0.16), (0.0, 0.16)],
        ],
        64,
        |angle, _| 1.0 + 0.1 * (libm::sin(angle * 16.0) * 2.5).clamp(-1.0, 1.0),
    );
    solid.add_at(&gear, 0.0, 0.7, 0.0);
    solid
}

/// Adds workbenches along both long walls with drawers, screens and clutter.
fn benches(builder: &mut ModelBuilder) {
    let mut bench = Solid::default();
    bench.add_at(&Solid::block(DVec3::new(0.85, 0.025, 0.33), 0.01), 0.0, 0.86, 0.0);
    for x in [-0.78, 0.78] {
        for z in [-0.27, 0.27] {
            bench.add_at(&Solid::block(DVec3::new(0.03, 0.42, 0.03), 0.005), x, 0.42, z);
        }
    }
    bench.add_at(&Solid::block(DVec3::new(0.8, 0.012, 0.28), 0.004), 0.0, 0.2, 0.0);
    for k in 0..3 {
        bench.add_at(
            &Solid::block(DVec3::new(0.2, 0.085, 0.28), 0.01),
            0.52,
            0.74 - 0.18 * f64::from(k),
            0.0,
        );
        bench.add_at(
            &Solid::block(DVec3::new(0.06, 0.008, 0.015), 0.004),
            0.52,
            0.74 - 0.18 * f64::from(k),
            0.3,
        );
    }
    let (plain, mut clutter) = (builder.plain, Solid::default());
    let mesh = builder.add_mesh("bench", bench, plain);
    for i in 0..6 {
        let side = if i % 2 == 0 { -1.0 } else { 1.0 };
        let (x, z) = ([-1.7, 1.0, 2.9][i / 2] - if side > 0.0 { 0.0 } else { 1.5 }, side * (HALF_Z - 0.5));
        let turned = if side > 0.0 { turn(1, PI) } else { DMat3::IDENTITY };
        let node = builder.add_turned_node(None, turned, x, 0.0, z);
        builder.place_mesh("bench", node, mesh);
        for k in 0..9 {
            let number = |j: i32, low, high| noise::between(51, (i as i32 * 16 + k) * 8 + j, low, high);
            let (dx, dz) = ((f64::from(k) - 4.0) * 0.17, number(0, -0.18, 0.18));
            if k % 3 == 0 {
                let can = Solid::lathe(
                    &[&[(0.045, 0.0), (0.045, 0.13)], &[(0.045, 0.13), (0.03, 0.15), (0.0, 0.15)]],
                    14,
                );
                clutter.add_at(&can, x + dx, 0.885, z + dz);
            } else {
                let half = DVec3::new(number(1, 0.03, 0.07), number(2, 0.02, 0.09), number(3, 0.03, 0.08));
                clutter.add(
                    &Solid::block(half, 0.006),
                    at(turn(1, number(4, -0.6, 0.6)), x + dx, 0.885 + half.y, z + dz),
                );
            }
        }
        let screen = DVec3::new(x - 0.3, 1.28, z + side * 0.2);
        clutter.add(
            &Solid::block(DVec3::new(0.27, 0.17, 0.012), 0.006),
            at(turn(0, side * 0.12), screen.x, screen.y, screen.z),
        );
        clutter.add_at(
            &Solid::block(DVec3::new(0.02, 0.12, 0.015), 0.004),
            screen.x,
            1.0,
            screen.z + side * 0.02,
        );
        clutter.add_at(&Solid::block(DVec3::new(0.12, 0.01, 0.07), 0.004), screen.x, 0.895, screen.z);
    }
    builder.add_static("clutter", clutter, plain);
}

/// Meshes of a robot arm's links, shared by all arms.
struct Links {
    meshes: [Option<usize>; 6],
}

impl Links {
    fn new(builder: &mut ModelBuilder) -> Self {
        let plain = builder.plain;
        let mut base = Solid::lathe(
            &[
                &[(0.28, 0.0), (0.28, 0.06)],
                &[(0.28, 0.06), (0.2, 0.1), (0.17, 0.28)],
                &[(0.17, 0.28), (0.0, 0.28)],
            ],
            32,
        );
        for k in 0..8 {
            let bolt = Solid::lathe(&[&[(0.02, 0.0), (0.02, 0.025)], &[(0.02, 0.025), (0.0, 0.025)]], 6);
            let angle = TAU * f64::from(k) / 8.0;
            base.add_at(&bolt, 0.24 * libm::cos(angle), 0.06, 0.24 * libm::sin(angle));
        }
        let drum = |radius: f64, half: f64| {
            let ends: [&[(f64, f64)]; 5] = [
                &[(0.0, -half), (radius - 0.02, -half)],
                &[(radius - 0.02, -half), (radius, 0.02 - half)],
                &[(radius, 0.02 - half), (radius, half - 0.02)],
                &[(radius, half - 0.02), (radius - 0.02, half)],
                &[(radius - 0.02, half), (0.0, half)],
            ];
            Solid::lathe(&ends, 24)
        };
        let across = turn(2, PI / 2.0);
        let mut turret = Solid::lathe(&[&[(0.19, 0.01), (0.19, 0.09)], &[(0.19, 0.09), (0.0, 0.12)]], 28);
        for side in [-0.16, 0.16] {
            turret.add_at(&Solid::block(DVec3::new(0.035, 0.17, 0.12), 0.02), side, 0.22, 0.0);
        }
        turret.add(&drum(0.1, 0.22), at(across, 0.0, 0.33, 0.0));
        let beam = |length: f64, wide: f64| {
            let mut solid = Solid::block(DVec3::new(wide, length / 2.0, wide * 0.8), 0.02);
            let ribs: Vec<Solid> = (0..3)
                .map(|_| Solid::block(DVec3::new(wide + 0.012, 0.03, wide * 0.8 + 0.012), 0.01))
                .collect();
            for (k, rib) in (0..3).zip(&ribs) {
                solid.add_at(rib, 0.0, (f64::from(k) - 1.0) * length * 0.27, 0.0);
            }
            let mut moved = Solid::default();
            moved.add_at(&solid, 0.0, length / 2.0, 0.0);
            moved
        };
        let mut upper = beam(0.62, 0.085);
        upper.add(&drum(0.085, 0.15), at(across, 0.0, 0.62, 0.0));
        upper.add(
            &Solid::pipe(
                &[DVec3::new(0.12, 0.05, 0.0), DVec3::new(0.15, 0.3, 0.05), DVec3::new(0.12, 0.58, 0.0)],
                0.018,
                8,
            ),
            DAffine3::IDENTITY,
        );
        let mut fore = beam(0.5, 0.062);
        fore.add(&drum(0.06, 0.1), at(across, 0.0, 0.5, 0.0));
        let mut hand = Solid::default();
        hand.add_at(&drum(0.055, 0.05), 0.0, 0.07, 0.0);
        hand.add_at(&Solid::block(DVec3::new(0.1, 0.02, 0.035), 0.008), 0.0, 0.14, 0.0);
        let mut finger = Solid::default();
        finger.add_at(&Solid::block(DVec3::new(0.014, 0.065, 0.025), 0.006), 0.0, 0.065, 0.0);
        let meshes = [
            ("base", base),
            ("turret", turret),
            ("upper arm", upper),
            ("forearm", fore),
            ("hand", hand),
            ("finger", finger),
        ];
        Self { meshes: meshes.map(|(name, solid)| builder.add_mesh(name, solid, plain)) }
    }

    /// Adds an arm at a place. Its joints swing in whole cycles.
    fn arm(&self, builder: &mut ModelBuilder, index: i32, place: DVec3, heading: f64) {
        let number = |k: i32, low, high| noise::between(71, index * 16 + k, low, high);
        let [base, turret, upper, fore, hand, finger] = self.meshes;
        let phase = number(0, 0.0, 1.0);
        let name = |part: &str| format!("arm {index} {part}");
        let root = builder.add_turned_node(None, turn(1, heading), place.x, place.y, place.z);
        builder.place_mesh(&name("base"), root, base);
        let top = builder.add_node(Some(root), 0.0, 0.28, 0.0);
        builder.animate_rotation(top, 150, |time| about(DVec3::Y, 0.9 * swing(time, 2.0, phase)));
        builder.place_mesh(&name("turret"), top, turret);
        let shoulder = builder.add_node(Some(top), 0.0, 0.33, 0.0);
        builder.animate_rotation(shoulder, 150, |time| {
            about(DVec3::X, 0.3 + 0.35 * swing(time, 3.0, phase + 0.2))
        });
        builder.place_mesh(&name("upper arm"), shoulder, upper);
        let elbow = builder.add_node(Some(shoulder), 0.0, 0.62, 0.0);
        builder.animate_rotation(elbow, 150, |time| {
            about(DVec3::X, 1.1 + 0.45 * swing(time, 3.0, phase + 0.55))
        });
        builder.place_mesh(&name("forearm"), elbow, fore);
        let wrist = builder.add_node(Some(elbow), 0.0, 0.5, 0.0);
        builder.animate_rotation(wrist, 150, |time| {
            about(DVec3::X, 0.5 + 0.4 * swing(time, 4.0, phase))
                * about(DVec3::Y, 1.4 * swing(time, 2.0, phase + 0.4))
        });
        builder.place_mesh(&name("hand"), wrist, hand);
        for side in [-1.0, 1.0] {
            let claw = builder.add_node(Some(wrist), 0.0, 0.0, 0.0);
            builder.animate_translation(claw, 150, |time| {
                DVec3::new(side * (0.05 + 0.03 * swing(time, 5.0, phase)), 0.155, 0.0)
            });
            builder.place_mesh(&name("finger"), claw, finger);
        }
    }
}

/// Adds two rings of walkers around the island in opposite directions, and pairs of walkers in the corners.
fn walkers(builder: &mut ModelBuilder) {
    let Some(walker) = WalkerMesh::new(builder) else { return };
    let ring = |half_x: f64, half_z: f64, start: f64, laps: f64| Track {
        centre: DVec3::ZERO,
        half_x,
        half_z,
        start,
        laps,
    };
    for i in 0..7 {
        let vary = 0.06 * f64::from(i % 3 - 1);
        walker.walk(builder, &ring(2.75 + vary, 1.75 + vary, f64::from(i) / 7.0, 1.0));
    }
    for i in 0..9 {
        let vary = 0.08 * f64::from(i % 3 - 1);
        walker.walk(builder, &ring(3.9 + vary, 2.75 + vary, f64::from(i) / 9.0, -1.0));
    }
    for (x, z) in [(4.9, 3.3), (-4.9, 3.3), (4.9, -2.8), (-4.9, -2.8)] {
        for k in 0..2 {
            let centre = DVec3::new(x, 0.0, z);
            let (start, laps) = (f64::from(k) / 2.0 + 0.1 * x, if x * z > 0.0 { 1.0 } else { -1.0 });
            walker.walk(builder, &Track { centre, half_x: 0.62, half_z: 0.58, start, laps });
        }
    }
}
