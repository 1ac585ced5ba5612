//! Views of streams of profile `surface`.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use psao_codec::surface::{BLOCK_POINTS, NO_VALUE, State};

use super::{Bounds, check, on_one_thread, row};
use crate::reconstruct::{ReconstructError, Statistics, SurfaceReconstructor, surface};
use crate::surface::AoSource;
use crate::testing::{
    Points, Reference, chart_of, fit_reference, nearest_reference, points, surface_state, unit,
};
use crate::{AoSampler, AtRest, GBuffer, Place, Size, Surface, SurfaceIndex};

/// Returns a fragment whose place in the world has nothing to do with its place at rest.
fn fragment(instance: u32, position: Vec3, normal: Vec3) -> Surface {
    let rest = Some(AtRest { position, normal, chart: chart_of(normal) });
    Surface { t: 1.0, position: Vec3::splat(1e3), normal: Vec3::NEG_X, instance, rest }
}

fn one(fragment: Surface) -> GBuffer {
    row(&[Some(fragment)])
}

/// Computes the fit over every point of the fragment's chart, level by level, for points of this spacing.
fn brute_force(state: &State, fragment: &Surface, spacing: f32, ao: &impl AoSource) -> Reference {
    let set = state.layout().members()[fragment.instance as usize].set;
    let geometry = state.geometry(set).unwrap();
    let rest = fragment.rest.unwrap();
    let (place, normal) = (rest.position.as_dvec3(), rest.normal.as_dvec3());
    let wanted = geometry.layout().level_within(spacing);
    let mut near_threshold = false;
    for level in (0..=wanted).rev() {
        let r = f64::from(geometry.layout().level_radius(level));
        let own = (0..geometry.len())
            .filter(|&point| geometry.chart(point) == rest.chart && geometry.level(point) <= level);
        let all: Vec<_> = own
            .map(|point| {
                let position = DVec3::from(geometry.position(point).map(f64::from));
                let direction = DVec3::from(geometry.normal(point).map(f64::from));
                (position, direction, ao(fragment.instance, point), geometry.level(point) == level)
            })
            .collect();
        let reached = |p: &DVec3, n: &DVec3| (*p - place).length() < r && n.dot(normal) > 0.5;
        let with_value = all.iter().filter_map(|(p, n, ao, _)| {
            ao.filter(|ao| *ao != NO_VALUE).map(|ao| (*p, *n, f64::from(ao) / 255.0))
        });
        let found = fit_reference(with_value.clone(), (place, normal), r);
        near_threshold |= found.near_threshold
            || all.iter().any(|(p, n, ..)| {
                let distance = (*p - place).length() / r;
                (distance - 1.0).abs() < 1e-4 || distance < 1.0001 && (n.dot(normal) - 0.5).abs() < 1e-4
            });
        let enough = with_value.filter(|(p, n, _)| reached(p, n)).count() >= 3;
        let finest = all.iter().filter(|(p, n, _, finest)| *finest && reached(p, n));
        let of_level: Vec<_> = finest.filter(|(.., ao, _)| *ao != Some(NO_VALUE)).collect();
        let missing = of_level.iter().filter(|(.., ao, _)| ao.is_none()).count();
        if enough && (level == 0 || missing == 0 || missing < of_level.len()) {
            return Reference { near_threshold, ..found };
        }
    }
    // The nearest points up to the level that was asked for: no point is within this radius.
    let r = f64::from(geometry.layout().level_radius(wanted));
    let all = (0..geometry.len()).filter_map(|point| {
        let counts = geometry.chart(point) == rest.chart && geometry.level(point) <= wanted;
        let ao = ao(fragment.instance, point).filter(|ao| counts && *ao != NO_VALUE)?;
        let position = DVec3::from(geometry.position(point).map(f64::from));
        Some((position, f64::from(ao) / 255.0))
    });
    let found = nearest_reference(all, (place, normal), r);
    Reference { near_threshold: near_threshold || found.near_threshold, ..found }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn fast_path_and_brute_force_agree(
        sets in [points(300), points(40)],
        fragments in prop::collection::vec((0_u32..3, prop::array::uniform3(-1.3_f32..1.3), unit()), 1..80),
        kernel_radius in 0.01_f32..0.9,
        width in 1_usize..10,
        spacing in prop::sample::select(vec![0.0_f32, 0.1, 0.4]),
        gone in prop::collection::vec((0_u32..3, 0_usize..5), 0..6),
    ) {
        // Two instances of the first set, whose AO differs.
        let value = |instance: u32, point: usize| (instance as usize * 91 + point * 37) as u8;
        let state = surface_state(kernel_radius, &sets, &[0, 1, 0], value);
        let ao = |instance: u32, point: usize| {
            let here = !gone.contains(&(instance, point / BLOCK_POINTS));
            here.then(|| value(instance, point))
        };
        let fragments = fragments.iter().map(|&(instance, at, normal)| Some(fragment(instance, at.into(), normal)));
        let mut pixels: Vec<_> = fragments.collect();
        pixels.resize(pixels.len().next_multiple_of(width), None);
        let size = Size::new(u32::try_from(width).unwrap(), u32::try_from(pixels.len() / width).unwrap()).unwrap();
        let view = GBuffer::from_fragments(size, pixels).unwrap();
        let reconstructor = || {
            let mut reconstructor = SurfaceReconstructor::new();
            let camera = psao_proto::message::CameraPose {
                eye: [999.0, 1000.0, 1000.0],
                target: [1e3; 3],
                up: [0.0, 1.0, 0.0],
                fov_y_deg: 2.0 * (spacing * 540.0).atan().to_degrees(),
                aspect: 1.0,
            };
            reconstructor.set_camera(&camera, if spacing > 0.0 { 1.0 } else { 0.0 });
            reconstructor
        };
        let found = reconstructor().blend(&state, &view, &ao).unwrap();
        let bounds = Bounds { value: 2e-3, near_thresholds: 3 };
        check(&found, &view, bounds, |fragment| brute_force(&state, fragment, spacing, &ao))?;
        let alone = on_one_thread(|| reconstructor().blend(&state, &view, &ao).unwrap());
        prop_assert_eq!(alone, found);
        // The sampler returns bit-identical values for the same places.
        let mut sampler = AoSampler::new();
        sampler.prepare(&state);
        let found = reconstructor().reconstruct(&state, &view).unwrap();
        for (pixel, &value) in found.image.values().iter().enumerate() {
            let Some(Surface { instance, rest: Some(rest), .. }) = view.fragment(pixel) else { continue };
            let AtRest { position, normal, chart } = rest;
            let place = Place { position: position.to_array(), normal: normal.to_array(), chart, spacing };
            let ao = sampler.ao(&state, instance, &place);
            prop_assert_eq!(ao.unwrap_or(1.0).to_bits(), value.to_bits());
        }
    }
}

#[test]
fn a_hundred_points_in_one_place_all_count() {
    let state = surface_state(0.1, &[vec![(Vec3::ZERO, Vec3::Y); 100]], &[0], |_, point| point as u8 + 1);
    let found = surface(&state, &one(fragment(0, Vec3::X * 0.01, Vec3::Y))).unwrap();
    assert_eq!(found.statistics.blended, 100, "none of them is nearer");
    assert!((found.image.values()[0] - 50.5 / 255.0).abs() < 1e-6);
}

#[test]
fn no_point_of_an_axis_aligned_plane_is_lost() {
    // 128 x 128 points on a plane, some four of them in each cell, as on the floors that defeat Eq. 1.
    let at = |i: usize| (i as f32 - 63.5) / 64.0;
    for axis in 0..3 {
        let point = |i: usize| {
            let [a, b] = [i % 128, i / 128].map(at);
            let place = [Vec3::new(0.5, a, b), Vec3::new(a, 0.5, b), Vec3::new(a, b, 0.5)][axis];
            (place, Vec3::AXES[axis])
        };
        let points: Points = (0..128 * 128).map(point).collect();
        let state =
            surface_state(0.016, std::slice::from_ref(&points), &[0], |_, point| 1 + (point % 251) as u8);
        let places: Vec<_> = points.iter().map(|&(place, normal)| Some(fragment(0, place, normal))).collect();
        let size = Size::new(128, 128).unwrap();
        let found = surface(&state, &GBuffer::from_fragments(size, places).unwrap()).unwrap();
        // The neighbours are 1/64 away and just count; the point itself has nearly all the weight.
        assert_eq!(found.statistics.unsupported, 0);
        for (point, value) in found.image.values().iter().enumerate() {
            assert!(
                (value * 255.0 - 1.0 - (point % 251) as f32).abs() < 25.0,
                "point {point}: {}",
                value * 255.0
            );
        }
        assert!(found.statistics.blended >= 128 * 128 * 4, "{:?}", found.statistics);
    }
}

#[test]
fn whatever_the_kernel_and_the_place_there_is_an_answer() {
    let points = vec![(Vec3::splat(-1.0), Vec3::Y), (Vec3::ONE, Vec3::Y), (Vec3::ZERO, Vec3::Y)];
    for kernel_radius in [f32::MIN_POSITIVE, 1e-20, 1e-3, 10.0, 1e18, f32::MAX] {
        let state = surface_state(kernel_radius, std::slice::from_ref(&points), &[0], |_, _| 51);
        let places = [0.0, -1.0, 1.0, 5.0, -5.0, 1e9, -1e9, f32::MAX, f32::INFINITY, f32::NAN];
        let fragments: Vec<_> =
            places.iter().map(|&at| Some(fragment(0, Vec3::splat(at), Vec3::Y))).collect();
        let found = surface(&state, &row(&fragments)).unwrap();
        for value in &found.image.values()[..3] {
            assert!((value - 0.2).abs() < 1e-6, "kernel {kernel_radius}: {value}");
        }
        assert_eq!(found.image.values()[8..], [1.0, 1.0]);
    }
}

#[test]
fn what_has_not_come_is_open_and_counted() {
    let all = surface_state(0.5, &[vec![(Vec3::ZERO, Vec3::Y)]], &[0, 0], |_, _| 51);
    let nothing = State::new(Arc::clone(all.layout()));
    let view = row(&[Some(fragment(0, Vec3::ZERO, Vec3::Y)), None, Some(fragment(1, Vec3::ZERO, Vec3::Y))]);
    let mut kept = SurfaceReconstructor::new();
    let open = kept.reconstruct(&nothing, &view).unwrap();
    assert_eq!(open.image.values(), [1.0; 3]);
    assert_eq!(open.statistics, Statistics { fragments: 2, unsupported: 2, blended: 0 });
    let closed = kept.reconstruct(&all, &view).unwrap();
    assert_eq!(closed.image.values(), [0.2, 1.0, 0.2], "the geometry came meanwhile");
}

#[test]
fn an_index_is_kept_as_long_as_its_geometry() {
    let [here, there] = [(Vec3::ZERO, 102), (Vec3::X * 0.5, 51)].map(|(place, ao)| {
        surface_state(0.1, &[vec![(place, Vec3::Y)], vec![(place, Vec3::Y)]], &[0, 1], |_, _| ao)
    });
    let view = one(fragment(0, Vec3::ZERO, Vec3::Y));
    let mut kept = SurfaceReconstructor::new();
    for (state, value) in [(&here, 0.4), (&here, 0.4), (&there, 0.2), (&here, 0.4)] {
        assert_eq!(kept.reconstruct(state, &view).unwrap().image.values(), [value]);
        let shown = Arc::as_ptr(state.geometry(0).unwrap());
        assert_eq!(kept.sampler().indices.geometries(), [Some(shown), None], "sets out of view cost nothing");
    }
}

#[test]
fn views_that_do_not_fit_are_errors() {
    let state = surface_state(0.1, &[vec![(Vec3::ZERO, Vec3::Y)]], &[0], |_, _| 0);
    let good = fragment(0, Vec3::ZERO, Vec3::Y);
    let unknown = row(&[Some(good), Some(Surface { instance: 1, ..good })]);
    let error = surface(&state, &unknown).unwrap_err();
    assert_eq!(error, ReconstructError::Instance { pixel: 1, instance: 1, instances: 1 });
    for view in [
        vec![None, Some(Surface { rest: None, ..good })],
        vec![Some(good), Some(Surface { rest: None, ..good })],
    ] {
        let error = surface(&state, &row(&view)).unwrap_err();
        assert_eq!(error, ReconstructError::NoRest { pixel: 1 });
        assert!(error.to_string().contains("fill in Surface::rest"), "{error}");
    }
    assert_eq!(
        surface(&state, &row(&[None])).unwrap().image.values(),
        [1.0],
        "nothing is shown, nothing is missing"
    );
}

#[test]
fn the_index_takes_what_it_says() {
    let points: Points = (0..1000).map(|i| (Vec3::X * (i as f32 / 1000.0), Vec3::Y)).collect();
    let state = surface_state(0.01, &[points], &[0], |_, _| 0);
    let bytes = SurfaceIndex::new(state.geometry(0).unwrap()).heap_bytes();
    assert!((36_000..72_000).contains(&bytes), "{bytes}");
}

#[test]
fn points_without_a_value_and_points_of_other_charts_do_not_count() {
    // A dark buried row beside a bright one, and a dark ceiling right above it.
    let line =
        |z: f32, y: f32, normal: Vec3| (0..9).map(move |i| (Vec3::new(i as f32 / 8.0 - 0.5, y, z), normal));
    let bright = line(0.0, 0.0, Vec3::Y).chain(line(0.1, 0.0, Vec3::Y));
    let points: Points = bright.chain(line(-0.1, 0.0, Vec3::Y)).chain(line(0.0, 0.01, Vec3::NEG_Y)).collect();
    let ao = |_: u32, point: usize| [204, 204, NO_VALUE, 26][point / 9];
    let state = surface_state(0.3, &[points], &[0], ao);
    let [floor, ceiling] =
        [Vec3::Y, Vec3::NEG_Y].map(|normal| fragment(0, Vec3::new(0.02, 0.0, -0.05), normal));
    let found = surface(&state, &row(&[Some(floor), Some(ceiling)])).unwrap();
    let [floor, ceiling] = [found.image.values()[0], found.image.values()[1]];
    assert!((floor - 0.8).abs() < 1e-4 && (ceiling - 26.0 / 255.0).abs() < 1e-4, "{floor} {ceiling}");
    assert_eq!(found.statistics.unsupported, 0);
}

#[test]
fn a_thin_part_takes_the_nearest_points_of_its_chart() {
    let points = vec![(Vec3::new(-0.9, 0.0, 0.0), Vec3::Y), (Vec3::new(0.9, 0.0, 0.0), Vec3::Y)];
    let state = surface_state(0.01, &[points], &[0], |_, point| [51, 204][point]);
    let places = [-0.9, -0.5, 0.0, 0.5, 0.9].map(|x| Some(fragment(0, Vec3::new(x, 0.0, 0.0), Vec3::Y)));
    let found = surface(&state, &row(&places)).unwrap();
    let values = found.image.values();
    assert!(values.is_sorted() && (values[2] - 0.5).abs() < 1e-5, "{values:?}");
    assert!((values[0] - 0.2).abs() < 0.05 && (values[4] - 0.8).abs() < 0.05, "{values:?}");
}
