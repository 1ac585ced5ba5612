//! `colonnade`: a paved hall between two rows of columns and arches, with swaying banners, masked plants and boulders
//! that roll through it. It is the counterpart of the paper's *Sponza* (section 4): much motion near everything.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::model_builder::{ModelBuilder, about, camera, swing};
use super::solid::{Solid, at, turn};
use super::{BuiltinScene, DURATION_S, noise};
use crate::scene::material::{AlphaMask, Material};
use crate::scene::mesh::{MorphTarget, SkinWeights};
use crate::scene::model::{MeshNode, Skin};
use crate::scene::raw_mesh::vertex_normals;
use crate::scene::texture::{Texture, Wrap};

/// Distance between columns of a row, metres.
const BAY_M: f64 = 2.2;
/// Number of columns of a row.
const COLUMNS: i32 = 5;
/// Distance of a row from the hall's middle, metres.
const ROW_M: f64 = 1.8;
/// Height at which the arches spring, metres.
const SPRING_M: f64 = 2.3;
/// Height of the wall above the arches, metres.
const TOP_M: f64 = 3.7;

/// Builds the scene.
pub(super) fn build() -> BuiltinScene {
    let mut builder = ModelBuilder::new();
    let (plain, thin) = (builder.plain, builder.thin);
    builder.add_static("paving", paving(), plain);
    let column = builder.add_mesh("column", column(), plain);
    let arch = builder.add_mesh("arch", arch(), plain);
    for row in [-ROW_M, ROW_M] {
        for i in 0..COLUMNS {
            let x = (f64::from(i) - 2.0) * BAY_M;
            let node = builder.add_node(None, x, 0.0, row);
            builder.place_mesh("column", node, column);
            if i + 1 < COLUMNS {
                let node = builder.add_node(None, x + BAY_M / 2.0, 0.0, row);
                builder.place_mesh("arch", node, arch);
            }
        }
    }
    builder.add_static("cornices", cornices(), plain);
    builder.add_static("wall", wall(), plain);
    banners(&mut builder, thin);
    pennants(&mut builder, thin);
    plants(&mut builder);
    boulders(&mut builder);
    let keys = [
        (0.0, [6.0, 1.7, 0.1], [0.0, 1.3, -0.3]),
        (3.0, [4.2, 1.5, 0.3], [-0.6, 1.2, -0.3]),
        (6.0, [3.3, 1.5, 1.8], [-0.8, 1.0, -0.4]),
        (9.0, [3.0, 1.8, 3.8], [-0.6, 0.9, -0.6]),
        (12.0, [5.9, 1.9, 2.4], [0.0, 1.0, -0.5]),
        (DURATION_S, [6.0, 1.7, 0.1], [0.0, 1.3, -0.3]),
    ];
    BuiltinScene { model: builder.model, ao_radius_m: 0.6, camera: camera(59.5, &keys) }
}

/// Slabs with chamfered edges and grooves between them, on a step. Their tops are at height 0.
fn paving() -> Solid {
    let mut solid = Solid::default();
    let (nx, nz, pitch) = (13, 9, 0.96);
    let slab = Solid::block(DVec3::new(0.49, 0.015, 0.47), 0.01).without_facing(DVec3::NEG_Y);
    for i in 0..nx {
        for j in 0..nz {
            solid.add_at(&slab, f64::from(i - nx / 2), -0.015, f64::from(j - nz / 2) * pitch);
        }
    }
    let (long, wide) = (f64::from(nx) / 2.0, f64::from(nz) * pitch / 2.0);
    let mut strip = |x: f64, z: f64, half_x: f64, half_z: f64| {
        let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];
        solid.polygon(&corners.map(|(a, b)| DVec3::new(x + a * half_x, -0.03, z + b * half_z)));
    };
    for i in 0..=nx {
        strip(f64::from(i) - long, 0.0, 0.012, wide);
    }
    for j in 0..=nz {
        strip(0.0, f64::from(j) * pitch - wide, long, 0.012);
    }
    let bar = |half: f64| Solid::bar(half, &[(0.16, -0.15), (0.16, -0.015), (0.145, 0.0), (0.0, 0.0)]);
    for side in [-1.0, 1.0] {
        solid.add_at(&bar(long + 0.32), 0.0, -0.02, side * (wide + 0.16));
        solid.add(&bar(wide), at(turn(1, PI / 2.0), side * (long + 0.16), -0.02, 0.0));
    }
    solid
}

/// A fluted column: plinth, moulded base, shaft, moulded capital, abacus.
fn column() -> Solid {
    let mut solid = Solid::default();
    solid.add_at(&Solid::block(DVec3::new(0.34, 0.07, 0.34), 0.015), 0.0, 0.07, 0.0);
    // Quarter and half rounds of the mouldings.
    let round = |r: f64, y: f64, size: f64| -> Vec<(f64, f64)> {
        let part = |k: i32| PI * (f64::from(k) / 8.0 - 0.5);
        (0..=8).map(|k| (r + size * libm::cos(part(k)), y + size * libm::sin(part(k)))).collect()
    };
    let base = [
        round(0.26, 0.19, 0.05),
        vec![(0.26, 0.24), (0.245, 0.27), (0.24, 0.3)],
        round(0.24, 0.325, 0.025),
        vec![(0.24, 0.35), (0.2, 0.352)],
    ];
    let capital = [
        round(0.2, 1.93, 0.02),
        vec![(0.2, 1.95), (0.2, 2.0)],
        vec![(0.2, 2.0), (0.22, 2.06), (0.27, 2.12), (0.32, 2.15)],
    ];
    for sections in [base.as_slice(), &capital] {
        let sections: Vec<&[(f64, f64)]> = sections.iter().map(Vec::as_slice).collect();
        solid.add(&Solid::lathe(&sections, 32), DAffine3::IDENTITY);
    }
    // The shaft swells a little, and its sixteen flutes end in round stops.
    let shaft: Vec<(f64, f64)> =
        (0..=12).map(|k| f64::from(k) / 12.0).map(|t| (0.235 - 0.03 * t * t, 0.34 + 1.58 * t)).collect();
    let flute = |angle: f64, height: f64| {
        let ends = ((height - 0.34).min(1.92 - height) / 0.12).clamp(0.0, 1.0);
        let wave = libm::cos(angle * 16.0);
        1.0 - 0.075 * ends * (1.0 - (wave * 0.5 + 0.5) * (wave * 0.5 + 0.5))
    };
    solid.add(&Solid::turned(&[&shaft], 64, flute), DAffine3::IDENTITY);
    solid.add_at(&Solid::block(DVec3::new(0.34, 0.075, 0.34), 0.02), 0.0, SPRING_M - 0.075, 0.0);
    solid
}

/// One bay of the arched wall, around x = 0: a half circle cut out of a wall, with a raised band around it.
fn arch() -> Solid {
    let (half, inner, thick) = (BAY_M / 2.0, 0.8, 0.25);
    let steps = 20;
    let angle = |k: i32| PI * f64::from(k) / f64::from(steps);
    let on_arc =
        |k: i32, r: f64, z: f64| DVec3::new(r * libm::cos(angle(k)), SPRING_M + r * libm::sin(angle(k)), z);
    let above = |k: i32, z: f64| DVec3::new(half * libm::cos(angle(k)), TOP_M, z);
    let mut solid = Solid::default();
    for k in 0..steps {
        let l = k + 1;
        solid.polygon(&[on_arc(k, inner, thick), above(k, thick), above(l, thick), on_arc(l, inner, thick)]);
        solid.polygon(&[
            on_arc(l, inner, -thick),
            above(l, -thick),
            above(k, -thick),
            on_arc(k, inner, -thick),
        ]);
    }
    for side in [1.0, -1.0] {
        for z in [thick, -thick] {
            let (foot, corner) = (DVec3::new(half * side, SPRING_M, z), DVec3::new(half * side, TOP_M, z));
            let spring = DVec3::new(inner * side, SPRING_M, z);
            let front = side * z > 0.0;
            let facing = if front { [spring, foot, corner] } else { [spring, corner, foot] };
            solid.polygon(&facing);
        }
        let strip = |x: f64, z: f64| DVec3::new(x * side, SPRING_M, z);
        let under = [strip(inner, -thick), strip(half, -thick), strip(half, thick), strip(inner, thick)];
        let mut under = under.to_vec();
        if side < 0.0 {
            under.reverse();
        }
        solid.polygon(&under);
    }
    // The soffit and the band: one closed profile swept along the half circle.
    let band =
        [(inner, -thick), (inner, -thick - 0.05), (inner + 0.14, -thick - 0.05), (inner + 0.14, -thick)];
    let other = band.map(|(r, z)| (r, -z));
    for k in 0..steps {
        let l = k + 1;
        solid.polygon(&[
            on_arc(k, inner, -thick),
            on_arc(k, inner, thick),
            on_arc(l, inner, thick),
            on_arc(l, inner, -thick),
        ]);
        for (profile, turned) in [(band, false), (other, true)] {
            for pair in profile.windows(2) {
                let [a, b] = [pair[0], pair[1]];
                let (r, s) = if turned { (a, b) } else { (b, a) };
                solid.polygon(&[
                    on_arc(k, r.0, r.1),
                    on_arc(k, s.0, s.1),
                    on_arc(l, s.0, s.1),
                    on_arc(l, r.0, r.1),
                ]);
            }
        }
    }
    solid
}

/// Mouldings and dentils on top of both rows.
fn cornices() -> Solid {
    let mut solid = Solid::default();
    let long = BAY_M * 2.0 + 0.45;
    let profile = [0.25, 0.31, 0.31, 0.27, 0.27, 0.36, 0.36, 0.42, 0.42, 0.0];
    let heights = [0.0, 0.0, 0.08, 0.08, 0.19, 0.19, 0.25, 0.29, 0.4, 0.4];
    let profile: Vec<(f64, f64)> = profile.into_iter().zip(heights).collect();
    let dentil = Solid::block(DVec3::new(0.06, 0.045, 0.035), 0.006);
    let side_wall = Solid::block(DVec3::new(0.155, (TOP_M - SPRING_M) / 2.0, 0.25), 0.0);
    let side_wall = side_wall.without_facing(DVec3::Y).without_facing(DVec3::NEG_Y);
    for row in [-ROW_M, ROW_M] {
        solid.add_at(&Solid::bar(long, &profile), 0.0, TOP_M, row);
        for i in 0..44 {
            for side in [-0.305, 0.305] {
                solid.add_at(&dentil, (f64::from(i) - 21.5) * 0.216, TOP_M + 0.14, row + side);
            }
        }
        // The short walls over the outer columns.
        for side in [-1.0, 1.0] {
            solid.add_at(&side_wall, side * (BAY_M * 2.0 + 0.155), (TOP_M + SPRING_M) / 2.0, row);
        }
    }
    solid
}

/// The back wall: courses of stone with joints, a plinth, a coping, pilasters.
fn wall() -> Solid {
    let mut solid = Solid::default();
    let (face, deep) = (-4.15, 0.03);
    let stone = Solid::block(DVec3::new(0.49, 0.19, deep), 0.012).without_facing(DVec3::NEG_Z);
    let half_stone = Solid::block(DVec3::new(0.24, 0.19, deep), 0.012).without_facing(DVec3::NEG_Z);
    let mut joints: Vec<[f64; 4]> = Vec::new();
    for course in 0..7 {
        let y = 0.5 + f64::from(course) * 0.4;
        let out = |i: i32| face - deep + noise::between(3, course * 40 + i, -0.015, 0.015);
        joints.push([0.0, y - 0.2, 6.5, 0.015]);
        let stones = 13 - course % 2;
        let first = if course % 2 == 0 { -6.0 } else { -5.5 };
        for i in 0..stones {
            let x = first + f64::from(i);
            solid.add_at(&stone, x, y, out(i));
            joints.push([x + 0.5, y, 0.015, 0.2]);
        }
        if course % 2 == 1 {
            joints.push([-6.0, y, 0.015, 0.2]);
            solid.add_at(&half_stone, -6.25, y, out(30)).add_at(&half_stone, 6.25, y, out(31));
        }
    }
    for [x, y, half_x, half_y] in joints {
        let corner = |(a, b): (f64, f64)| DVec3::new(x + a * half_x, y + b * half_y, face - 2.0 * deep);
        solid.polygon(&[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner));
    }
    let plinth = [(0.14, 0.0), (0.14, 0.24), (0.1, 0.28), (0.0, 0.3)];
    let coping = [(0.05, 3.1), (0.14, 3.13), (0.14, 3.2), (0.18, 3.24), (0.18, 3.3), (0.0, 3.3)];
    for profile in [plinth.as_slice(), &coping] {
        solid.add_at(&Solid::bar(6.5, profile).without_facing(DVec3::NEG_Z), 0.0, 0.0, face - 0.06);
    }
    let pilaster = Solid::block(DVec3::new(0.2, 1.4, 0.06), 0.03).without_facing(DVec3::NEG_Z);
    for i in 0..4 {
        solid.add_at(&pilaster, (f64::from(i) - 1.5) * 3.3, 1.7, face + 0.05);
    }
    solid
}

/// Adds cloths that hang from the arches' crowns on chains of joints: one mesh, one rest, six instances.
fn banners(builder: &mut ModelBuilder, material: usize) {
    let (columns, rows, joints, height) = (12, 24, 6_usize, 1.15);
    let mut raw = Solid::sheet(0.8, height, columns, rows).raw("banner");
    let follow = |p: &Vec3| {
        let along = f64::from(-p.y) / height * (joints - 1) as f64;
        let (low, share) = ((along as usize).min(joints - 2), along - along.floor());
        let share = if along as usize > low { 1.0 } else { share };
        ([low as u16, low as u16 + 1, 0, 0], [1.0 - share as f32, share as f32, 0.0, 0.0])
    };
    let (numbers, weights) = raw.positions.iter().map(follow).unzip();
    raw.skin = Some(SkinWeights { sets: 1, joints: numbers, weights });
    let mesh = builder.model.add_mesh(raw, material);
    let step = height / (joints - 1) as f64;
    for i in 0..6 {
        let (bay, row) = (f64::from(i % 3) - 1.0, if i < 3 { -ROW_M } else { ROW_M });
        let phase = noise::uniform(23, i);
        let holder = builder.add_node(None, bay * BAY_M + BAY_M / 2.0, SPRING_M + 0.78, row);
        let mut nodes = Vec::new();
        let mut parent = holder;
        for joint in 0..joints {
            let down = if joint == 0 { 0.0 } else { -step };
            parent = builder.add_node(Some(parent), 0.0, down, 0.0);
            nodes.push(parent);
            // The wave runs down the cloth and grows. A slower wave moves the whole cloth.
            let share = joint as f64 / joints as f64;
            let amount = 0.07 + 0.12 * share;
            builder.animate_rotation(parent, 180, |time| {
                let bend = amount * swing(time, 5.0, phase - 0.45 * share) + 0.06 * swing(time, 2.0, phase);
                let twist = 0.07 * swing(time, 3.0, phase * 1.7 - 0.3 * share);
                about(DVec3::X, bend) * about(DVec3::Y, twist)
            });
        }
        let inverse_bind =
            (0..joints).map(|j| DAffine3::from_translation(DVec3::Y * (step * j as f64))).collect();
        builder.model.skins.push(Skin { joints: nodes, inverse_bind });
        let skin = Some(builder.model.skins.len() - 1);
        if let Some(mesh) = mesh {
            let name = format!("banner {i}");
            builder.model.mesh_nodes.push(MeshNode { name, node: holder, mesh, skin, weights: Vec::new() });
        }
    }
}

/// Adds pennants that ripple by two morph targets, a sine and a cosine. Together they make a travelling wave.
fn pennants(builder: &mut ModelBuilder, material: usize) {
    let (columns, rows, width, height) = (28, 10, 1.3, 0.45);
    let mut raw = Solid::sheet(width, height, columns, rows).raw("pennant");
    let base = vertex_normals(&raw.positions, &raw.triangles);
    let target = |quarter: f64| {
        let ripple = |p: &Vec3| {
            let along = (f64::from(p.x) + width / 2.0) / width;
            Vec3::Z * (0.13 * along * libm::sin(TAU * (1.3 * along + quarter))) as f32
        };
        let positions: Vec<Vec3> = raw.positions.iter().map(ripple).collect();
        let moved: Vec<Vec3> = raw.positions.iter().zip(&positions).map(|(p, d)| p + d).collect();
        let bent = vertex_normals(&moved, &raw.triangles);
        MorphTarget {
            positions,
            normals: bent.iter().zip(&base).map(|(b, n)| b - n).collect(),
            tangents: Vec::new(),
        }
    };
    raw.morphs = vec![target(0.0), target(0.25)];
    let mesh = builder.model.add_mesh(raw, material);
    let poles = [Vec3::new(-5.6, 0.0, -2.6), Vec3::new(-5.6, 0.0, 2.6), Vec3::new(5.7, 0.0, -2.6)];
    let plain = builder.plain;
    for (i, pole) in poles.iter().enumerate() {
        let (x, z) = (f64::from(pole.x), f64::from(pole.z));
        let path: Vec<DVec3> = (0..=4).map(|k| DVec3::new(x, 0.65 * f64::from(k), z)).collect();
        let mut mast = Solid::pipe(&path, 0.03, 12);
        let foot = Solid::lathe(
            &[&[(0.2, 0.0), (0.2, 0.06)], &[(0.2, 0.06), (0.12, 0.1), (0.05, 0.22), (0.03, 0.3)]],
            20,
        );
        mast.add_at(&foot, x, 0.0, z).add_at(&Solid::ball(2, |_| 0.055), x, 2.63, z);
        builder.add_static("mast", mast, plain);
        let node = builder.add_node(None, x + width / 2.0 + 0.03, 2.5, z);
        let phase = 0.3 * i as f64;
        builder.animate_morph_weights(node, 2, 240, |time| {
            vec![swing(time, 10.0, phase) as f32, swing(time, 10.0, phase + 0.25) as f32]
        });
        if let Some(mesh) = mesh {
            let name = format!("pennant {i}");
            builder.model.mesh_nodes.push(MeshNode { name, node, mesh, skin: None, weights: vec![0.0; 2] });
        }
    }
}

/// Returns the alpha of a spray of leaves on twigs, 128 texels square.
fn foliage() -> Arc<[[u8; 1]]> {
    const SIZE: i32 = 128;
    let leaves: Vec<[f64; 5]> = (0..46)
        .map(|i| {
            let number = |k: i32, low, high| noise::between(61, i * 8 + k, low, high);
            let angle = number(2, 0.0, TAU);
            [
                number(0, 0.1, 0.9),
                number(1, 0.08, 0.92),
                libm::cos(angle),
                libm::sin(angle),
                number(3, 0.09, 0.15),
            ]
        })
        .collect();
    let alpha = |x: f64, y: f64| {
        let leaf = |[cx, cy, dx, dy, length]: &[f64; 5]| {
            let along = ((x - cx) * dx + (y - cy) * dy) / length;
            let across = ((y - cy) * dx - (x - cx) * dy) / length;
            if along.abs() < 1.0 {
                0.42 * (1.0 - along * along) * (1.0 - 0.3 * along) - across.abs()
            } else {
                -1.0
            }
        };
        let stem = 0.012 - (x - 0.5 - 0.06 * libm::sin(y * 9.0)).abs();
        leaves.iter().map(leaf).fold(stem * 8.0, f64::max)
    };
    let texel = |i: i32| {
        let (x, y) =
            ((f64::from(i % SIZE) + 0.5) / f64::from(SIZE), (f64::from(i / SIZE) + 0.5) / f64::from(SIZE));
        [(alpha(x, y) * 1200.0 + 128.0).clamp(0.0, 255.0) as u8]
    };
    (0..SIZE * SIZE).map(texel).collect()
}

/// Adds potted plants and ivy, made of masked cards.
fn plants(builder: &mut ModelBuilder) {
    let texture = Texture::new([128, 128], [Wrap::Clamp; 2], false, foliage());
    let mask = Some(AlphaMask { texture, factor: 1.0, cutoff: 0.5 });
    let leaves = Material { name: "leaves".to_owned(), double_sided: true, mask, normal_map: None };
    let leaves = builder.model.add_material(leaves);
    let plain = builder.plain;
    let pot: [&[(f64, f64)]; 5] = [
        &[(0.0, 0.0), (0.16, 0.0)],
        &[(0.16, 0.0), (0.22, 0.28), (0.23, 0.34)],
        &[(0.23, 0.34), (0.26, 0.34), (0.26, 0.4), (0.23, 0.4)],
        &[(0.23, 0.4), (0.2, 0.33)],
        &[(0.2, 0.33), (0.0, 0.35)],
    ];
    let pot = builder.add_mesh("pot", Solid::lathe(&pot, 28), plain);
    let card = |width: f64, height: f64| {
        let (a, b) = (width / 2.0, height);
        let mut solid = Solid::default();
        solid.polygon(&[[-a, 0.0], [a, 0.0], [a, b], [-a, b]].map(|[x, y]| DVec3::new(x, y, 0.0)));
        solid
    };
    let mut bush = Solid::default();
    for i in 0..9 {
        let number = |k: i32, low, high| noise::between(29, i * 8 + k, low, high);
        let lean = turn(1, TAU * f64::from(i) / 9.0) * turn(0, number(0, 0.1, 0.75));
        bush.add(&card(0.55, number(1, 0.6, 0.85)), at(lean, 0.0, 0.36, 0.0));
    }
    let bush = builder.add_mesh("bush", bush, leaves);
    for (i, (x, z)) in
        [(-5.4, 0.0), (5.5, -3.4), (-2.2, -3.75), (2.2, -3.75), (5.6, 1.9), (-5.6, -3.6)].iter().enumerate()
    {
        let node = builder.add_turned_node(None, turn(1, i as f64 * 1.3), *x, 0.0, *z);
        builder.place_mesh("pot", node, pot);
        builder.place_mesh("bush", node, bush);
    }
    // Ivy grows on two columns and the wall.
    let mut ivy = Solid::default();
    for i in 0..44 {
        let number = |k: i32, low, high| noise::between(31, i * 8 + k, low, high);
        let (angle, height) = (number(0, 0.0, TAU), number(1, 0.1, 1.75));
        let row = if i % 2 == 0 { (-2.0 * BAY_M, -ROW_M) } else { (BAY_M, -ROW_M) };
        let place = turn(1, angle) * turn(0, number(2, -0.25, 0.1));
        let out = place * DVec3::new(0.0, 0.0, 0.25);
        ivy.add(&card(0.34, 0.36), at(place, row.0 + out.x, height, row.1 + out.z));
    }
    for i in 0..30 {
        let number = |k: i32, low, high| noise::between(37, i * 8 + k, low, high);
        let x = number(0, -3.4, -1.6);
        let tall = number(1, 0.0, 2.4) * (1.0 - (x + 2.5).abs() * 0.6);
        ivy.add(
            &card(0.4, 0.42),
            at(turn(0, number(2, -0.15, 0.2)), x, tall + 0.3, -4.1 + number(3, 0.02, 0.06)),
        );
    }
    builder.add_static("ivy", ivy, leaves);
}

/// Returns the place and heading (radians about y, 0 along x) of a boulder after it has rolled `s` metres along the
/// loop around one row.
fn along_loop(s: f64, row: f64) -> (DVec3, f64) {
    let inward = -row.signum();
    let (half, radius) = (4.9, 1.42);
    let (straight, bend) = (2.0 * half, PI * radius);
    let s = s.rem_euclid(2.0 * (straight + bend));
    // The loop runs along the hall, round the end column, back outside, and round the other end column.
    let (x, out, turned) = if s < straight {
        (s - half, radius, 0.0)
    } else if s < straight + bend {
        let a = (s - straight) / radius;
        (half + radius * libm::sin(a), radius * libm::cos(a), a)
    } else if s < 2.0 * straight + bend {
        (half - (s - straight - bend), -radius, PI)
    } else {
        let a = (s - 2.0 * straight - bend) / radius;
        (-half - radius * libm::sin(a), -radius * libm::cos(a), PI + a)
    };
    (DVec3::new(x, 0.0, row + inward * out), turned * inward)
}

/// Adds boulders on two closed loops, one around each row. They roll without sliding: the rolled angle is the
/// distance over the mean radius. The radius makes a lap a whole number of turns, and each lap takes the whole clip.
fn boulders(builder: &mut ModelBuilder) {
    let lap = 2.0 * (2.0 * 4.9 + PI * 1.42);
    let plain = builder.plain;
    for i in 0..6 {
        let row = if i % 2 == 0 { ROW_M } else { -ROW_M };
        let turns = [11.0, 13.0, 16.0, 12.0, 18.0, 14.0][i];
        let radius = lap / (TAU * turns);
        let rock = Solid::ball(3, |direction| radius * noise::rock(200 + i as u32, direction, 0.22));
        let points: Vec<DVec3> = rock.positions().iter().map(|p| p.as_dvec3()).collect();
        let mesh = builder.add_mesh("boulder", rock, plain);
        let node = builder.add_node(None, 0.0, 0.0, 0.0);
        builder.place_mesh(&format!("boulder {i}"), node, mesh);
        // Three boulders share a loop. Those of one loop are offset from those of the other.
        let start = lap * (i / 2) as f64 / 3.0 + if row > 0.0 { 0.0 } else { lap / 6.0 };
        let state = |time: f64| {
            let way = lap * time / DURATION_S;
            let (place, heading) = along_loop(start + way, row);
            (place, about(DVec3::Y, heading) * about(DVec3::Z, -way / radius))
        };
        builder.animate_rotation(node, 900, |time| state(time).1);
        // The lowest point of the boulder touches the floor.
        builder.animate_translation(node, 900, |time| {
            let (place, rotation) = state(time);
            let up = DMat3::from_quat(rotation).transpose().y_axis;
            let lowest = points.iter().map(|p| up.dot(*p)).fold(0.0, f64::min);
            place - DVec3::Y * lowest
        });
    }
}
