//! `asteroids`: a detailed ship that never moves, and tumbling rocks that stay at least 2 m away from it and from
//! each other. It is the counterpart of the paper's scene *Space* (section 4): nearly all ambient occlusion is
//! constant.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DVec3};

use super::model_builder::{ModelBuilder, about, camera, swing};
use super::solid::{Solid, at, turn};
use super::{BuiltinScene, DURATION_S, noise};

/// Number of rocks in the scene.
const ROCKS: i32 = 14;
/// Number of different rock shapes.
const SHAPES: usize = 5;
/// Free space between any two bodies, metres.
const GAP_M: f64 = 2.0;
/// Largest drift of a rock from its place, metres.
const DRIFT_M: f64 = 0.4;
/// Half axes of an ellipsoid that contains the whole ship, metres.
const SHIP_HALF: DVec3 = DVec3::new(5.4, 2.9, 8.4);

/// Builds the scene.
pub(super) fn build() -> BuiltinScene {
    let mut builder = ModelBuilder::new();
    let plain = builder.plain;
    builder.add_static("hull", hull(), plain);
    builder.add_static("greebles", greebles(), plain);
    builder.add_static("wings", wings(), plain);
    builder.add_static("engines", engines(), plain);
    builder.add_static("antennas", antennas(), plain);
    let dish = dish();
    let thin = builder.thin;
    builder.add_static("dish", dish, thin);
    rocks(&mut builder);
    let keys = [
        (0.0, [9.0, 4.5, 10.0], [0.0, 0.2, 0.5]),
        (4.0, [11.0, 3.0, 2.5], [0.0, 0.2, 0.0]),
        (8.0, [8.0, 4.5, -6.5], [0.0, 0.2, -1.0]),
        (12.0, [9.5, 5.0, 5.0], [0.0, 0.2, 0.0]),
        (DURATION_S, [9.0, 4.5, 10.0], [0.0, 0.2, 0.5]),
    ];
    BuiltinScene { model: builder.model, ao_radius_m: 0.6, camera: camera(55.0, &keys) }
}

/// Returns the radius of the hull's cross-section at a place along the ship (z from -6 at the stern to 7.2 at the
/// bow).
fn hull_radius(z: f64) -> f64 {
    let t = ((z + 6.0) / 13.2).clamp(0.0, 1.0);
    let nose = (1.0 - t * t * t * t).max(0.0).sqrt();
    1.25 * nose * (0.86 + 0.14 * libm::sin(PI * t.min(0.6) / 0.6))
}

/// Returns the transform from lathe coordinates (y up) to the ship's (z ahead), slightly flattened.
fn along_ship() -> DAffine3 {
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(1.15, 0.85, 1.0)) * turn(0, PI / 2.0),
        translation: DVec3::ZERO,
    }
}

fn hull() -> Solid {
    let mut sections: Vec<Vec<(f64, f64)>> = Vec::new();
    // The hull has plates with grooves between them.
    let plates = 11;
    let place = |i: i32| -6.0 + 13.2 * f64::from(i) / f64::from(plates);
    for i in 0..plates {
        let (a, b) = (place(i) + 0.03, place(i + 1) - 0.03);
        let ring = |k: i32| a + (b - a) * f64::from(k) / 5.0;
        let low = hull_radius(a) - 0.05;
        sections.push(vec![(low, a), (hull_radius(a), a)]);
        sections.push((0..=5).map(|k| (hull_radius(ring(k)), ring(k))).collect());
        if i + 1 < plates {
            let (edge, deep) = (hull_radius(b), hull_radius(place(i + 1) + 0.03) - 0.05);
            sections.push(vec![(edge, b), (deep, b)]);
            sections.push(vec![(deep, b), (deep, place(i + 1) + 0.03)]);
        }
    }
    sections.push(vec![(hull_radius(7.17), 7.17), (0.0, 7.2)]);
    sections.insert(0, vec![(0.0, -5.97), (hull_radius(-5.97), -5.97)]);
    let sections: Vec<&[(f64, f64)]> = sections.iter().map(Vec::as_slice).collect();
    let mut solid = Solid::default();
    solid.add(&Solid::lathe(&sections, 40), along_ship());
    // The bridge and the frames of its windows.
    let bridge = Solid::lathe(
        &[&[(0.75, 0.0), (0.75, 0.25)], &[(0.75, 0.25), (0.62, 0.55), (0.36, 0.75), (0.0, 0.82)]],
        24,
    );
    let stretched = DMat3::from_diagonal(DVec3::new(0.9, 1.0, 1.8));
    solid.add(&bridge, at(stretched, 0.0, 0.85, 2.2));
    for i in 0..7 {
        let frame = Solid::block(DVec3::new(0.03, 0.26, 0.05), 0.01);
        let angle = (f64::from(i) - 3.0) * 0.42;
        let out = DVec3::new(libm::sin(angle) * 0.68, 1.2, 2.2 + libm::cos(angle) * 1.32);
        solid.add(&frame, at(turn(1, angle) * turn(0, -0.5), out.x, out.y, out.z));
    }
    solid
}

/// Small boxes and vents all over the hull.
fn greebles() -> Solid {
    let mut solid = Solid::default();
    for i in 0..230 {
        let number = |k: i32, low, high| noise::between(41, i * 8 + k, low, high);
        let (z, angle) = (number(0, -5.4, 5.2), number(1, 0.0, TAU));
        let radius = hull_radius(z);
        let (x, y) = (radius * 1.15 * libm::cos(angle), radius * 0.85 * libm::sin(angle));
        let half = DVec3::new(number(2, 0.04, 0.2), number(3, 0.02, 0.09), number(4, 0.05, 0.32));
        // The block stands on the surface: up is the ellipse's normal.
        let tilt = libm::atan2(libm::sin(angle) / 0.85, libm::cos(angle) / 1.15) - PI / 2.0;
        let place = at(turn(2, tilt), x, y, z);
        solid.add(&Solid::block(half, half.y * 0.3).without_facing(DVec3::NEG_Y), place);
        if i % 6 == 0 {
            let knob =
                Solid::lathe(&[&[(0.06, 0.0), (0.06, 0.16)], &[(0.06, 0.16), (0.045, 0.2), (0.0, 0.2)]], 10);
            solid.add(&knob, place * DAffine3::from_translation(DVec3::new(0.0, half.y, 0.0)));
        }
    }
    solid
}

/// A pair of swept wings with ribs, and the fin.
fn wings() -> Solid {
    let mut solid = Solid::default();
    let plan = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    for side in [-1.0, 1.0] {
        let mut wing = Solid::default();
        // Root and tip sections: leading edge, upper crest, trailing edge, lower crest.
        let section = |x: f64, ahead: f64, behind: f64, thick: f64, y: f64| {
            let crest = ahead * 0.65 + behind * 0.35;
            vec![plan(x, y, ahead), plan(x, y + thick, crest), plan(x, y, behind), plan(x, y - thick, crest)]
        };
        let (root, tip) = (section(0.9, 1.2, -4.6, 0.2, -0.1), section(4.6, -2.6, -5.0, 0.07, 0.35));
        for i in 0..4 {
            let j = (i + 1) % 4;
            wing.polygon(&[root[j], root[i], tip[i], tip[j]]);
        }
        wing.polygon(&[tip[3], tip[2], tip[1], tip[0]]);
        for i in 0..7 {
            let x = 1.5 + 0.42 * f64::from(i);
            let t = (x - 0.9) / 3.7;
            let (ahead, y) = (1.2 - 3.8 * t, -0.1 + 0.45 * t);
            let rib = Solid::block(DVec3::new(0.03, 0.24 - 0.15 * t, (ahead + 4.7) * 0.32), 0.01);
            wing.add_at(&rib, x, y, (ahead - 4.7) / 2.0);
        }
        let pod = Solid::lathe(
            &[
                &[(0.0, -1.1), (0.16, -1.1)],
                &[(0.16, -1.1), (0.2, -0.4), (0.2, 0.8), (0.12, 1.5), (0.0, 1.75)],
            ],
            16,
        );
        wing.add(&pod, at(turn(0, PI / 2.0), 4.65, 0.35, -3.7));
        solid.add(&wing, DAffine3::from_scale(DVec3::new(side, 1.0, 1.0)));
    }
    let base = [plan(0.08, 0.9, -1.8), plan(-0.08, 0.9, -1.8), plan(-0.08, 0.7, -5.8), plan(0.08, 0.7, -5.8)];
    let top = [plan(0.03, 2.5, -4.9), plan(-0.03, 2.5, -4.9), plan(-0.03, 2.5, -6.2), plan(0.03, 2.5, -6.2)];
    for i in 0..4 {
        let j = (i + 1) % 4;
        solid.polygon(&[base[j], base[i], top[i], top[j]]);
    }
    solid.polygon(&[top[3], top[2], top[1], top[0]]);
    solid
}

/// Four engines on struts, with hollow nozzles.
fn engines() -> Solid {
    let outside: &[(f64, f64)] =
        &[(0.5, -1.9), (0.42, -1.5), (0.46, -1.2), (0.46, 0.9), (0.38, 1.25), (0.2, 1.4)];
    let inside: &[(f64, f64)] = &[(0.2, -1.2), (0.34, -1.3), (0.45, -1.9)];
    let back: &[(f64, f64)] = &[(0.45, -1.9), (0.5, -1.9)];
    let intake: &[(f64, f64)] = &[(0.2, 1.4), (0.0, 1.1)];
    let throat: &[(f64, f64)] = &[(0.0, -1.2), (0.2, -1.2)];
    // Sections run from bottom to top on the outside and the other way on the inside.
    let mut engine = Solid::lathe(&[outside, intake], 24);
    let reversed: Vec<Vec<(f64, f64)>> = [throat, inside, back].iter().map(|s| s.to_vec()).collect();
    let reversed: Vec<&[(f64, f64)]> = reversed.iter().map(Vec::as_slice).collect();
    engine.add(&Solid::lathe(&reversed, 24), DAffine3::IDENTITY);
    for i in 0..6 {
        let ring = Solid::lathe(&[&[(0.46, 0.0), (0.5, 0.02), (0.5, 0.06), (0.46, 0.08)]], 24);
        engine.add_at(&ring, 0.0, -0.9 + 0.3 * f64::from(i), 0.0);
    }
    let mut solid = Solid::default();
    for (x, y) in [(1.75, 0.75), (-1.75, 0.75), (1.75, -0.75), (-1.75, -0.75)] {
        solid.add(&engine, at(turn(0, PI / 2.0), x, y, -5.2));
        let strut = Solid::block(DVec3::new(0.55, 0.1, 0.7), 0.04);
        let lean = libm::atan2(y, x);
        solid.add(&strut, at(turn(2, lean), x * 0.62, y * 0.62, -5.0));
    }
    solid
}

fn antennas() -> Solid {
    let mut solid = Solid::default();
    for i in 0..9 {
        let number = |k: i32, low, high| noise::between(77, i * 8 + k, low, high);
        let (x, z, tall) = (number(0, -0.6, 0.6), number(1, -4.5, 4.0), number(2, 0.5, 1.1));
        let foot = DVec3::new(x, if i % 3 == 0 { -0.8 } else { 0.75 }, z);
        let up = if i % 3 == 0 { -1.0 } else { 1.0 };
        let bend = |t: f64| foot + DVec3::new(0.1 * t * t, up * tall * t, -0.2 * t * t);
        let path: Vec<DVec3> = (0..=6).map(|k| bend(f64::from(k) / 6.0)).collect();
        solid.add(&Solid::pipe(&path, 0.022, 8), DAffine3::IDENTITY);
        solid.add(&Solid::ball(1, |_| 0.05), DAffine3::from_translation(bend(1.0)));
    }
    // A mast between bridge and fin carries the dish.
    let mast = [DVec3::new(0.0, 0.7, -0.8), DVec3::new(0.0, 1.4, -0.8), DVec3::new(0.0, 1.7, -0.75)];
    solid.add(&Solid::pipe(&mast, 0.06, 10), DAffine3::IDENTITY);
    solid
}

fn dish() -> Solid {
    let bowl: Vec<(f64, f64)> =
        (0..=8).map(|k| f64::from(k) / 8.0).map(|t| (0.7 * t, 0.28 * t * t)).collect();
    let mut solid = Solid::default();
    solid.add(&Solid::lathe(&[&bowl], 28), at(turn(0, -0.5), 0.0, 1.7, -0.75));
    solid
}

/// Place and size of a rock.
struct Rock {
    place: DVec3,
    radius: f64,
}

/// Places rocks one by one where there is room.
fn placed_rocks() -> Vec<Rock> {
    let mut rocks: Vec<Rock> = Vec::new();
    let mut tries = 0;
    while (rocks.len() as i32) < ROCKS && tries < 4000 {
        let number = |k: i32, low, high| noise::between(13, tries * 8 + k, low, high);
        let place = DVec3::new(number(0, -13.0, 13.0), number(1, -6.0, 6.0), number(2, -14.0, 14.0));
        let radius = number(3, 0.4, 1.0);
        // The reach includes roughness and drift.
        let reach = |radius: f64| radius * 1.3 + DRIFT_M;
        let room = GAP_M + reach(radius);
        let clear_of_ship = (place / (SHIP_HALF + DVec3::splat(room))).length() > 1.0;
        let clear = |other: &Rock| place.distance(other.place) > room + reach(other.radius);
        tries += 1;
        if clear_of_ship && rocks.iter().all(clear) {
            rocks.push(Rock { place, radius });
        }
    }
    rocks
}

fn rocks(builder: &mut ModelBuilder) {
    let plain = builder.plain;
    for (i, rock) in placed_rocks().into_iter().enumerate() {
        let seed = 100 + 10 * (i % SHAPES) as u32;
        let level = if rock.radius > 0.7 { 4 } else { 3 };
        let solid = Solid::ball(level, |direction| rock.radius * noise::rock(seed, direction, 0.42));
        let mesh = builder.add_mesh("rock", solid, plain);
        let number = |k: i32, low, high| noise::between(17, i as i32 * 8 + k, low, high);
        let node = builder.add_node(None, rock.place.x, rock.place.y, rock.place.z);
        builder.place_mesh(&format!("rock {i}"), node, mesh);
        let axis = DVec3::new(number(0, -1.0, 1.0), number(1, -1.0, 1.0), number(2, 0.1, 1.0)).normalize();
        let turns = if i % 2 == 0 { 1.0 } else { -2.0 };
        builder.animate_rotation(node, 60, |time| about(axis, TAU * turns * time / DURATION_S));
        let phase = number(3, 0.0, 1.0);
        builder.animate_translation(node, 90, |time| {
            let drift = DVec3::new(
                swing(time, 1.0, phase),
                swing(time, 1.0, phase + 0.3),
                swing(time, 1.0, phase + 0.6),
            );
            rock.place + drift * (DRIFT_M / 1.8)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rock_finds_room() {
        assert_eq!(placed_rocks().len() as i32, ROCKS);
    }
}
