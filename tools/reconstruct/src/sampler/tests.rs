use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;
use psao_codec::paper::Pose;
use psao_codec::paper::{Grid, PointSample};

use super::*;
use crate::testing::{Margins, TestInstance, points, reference, state, surface_state, unit};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Samples more places than a chunk has, most of them several times, so that cached points are used.
    #[test]
    fn many_places_have_the_values_of_each_and_of_the_reference(
        sets in [points(200), points(40)],
        places in prop::collection::vec((prop::array::uniform3(-1.1_f32..1.1), unit()), 1..80),
        kernel_radius in 0.02_f32..0.9,
        instance in 0_u32..3,
    ) {
        let state = surface_state(kernel_radius, &sets, &[0, 1, 0], |instance, point| {
            (instance as usize * 91 + point * 37) as u8
        });
        let mut sampler = AoSampler::new();
        sampler.prepare(&state);
        let places: Vec<_> = places.iter().cycle().take(PLACES_PER_CHUNK + 3 * places.len()).collect();
        let positions: Vec<_> = places.iter().map(|place| place.0).collect();
        let normals: Vec<_> = places.iter().map(|place| place.1.to_array()).collect();
        let mut many = vec![Some(-1.0); places.len()];
        sampler.ao_many(&state, instance, &positions, &normals, &mut many).unwrap();
        for ((position, normal), many) in positions.iter().zip(&normals).zip(&many) {
            let one = sampler.ao(&state, instance, *position, *normal);
            prop_assert_eq!(one.map(f32::to_bits), many.map(f32::to_bits));
        }
        let geometry = state.geometry(state.layout().members()[instance as usize].set).unwrap();
        let (position, normal) = (positions[0], normals[0]);
        let values = state.values(instance);
        let all = (0..geometry.len()).map(|point| {
            let [position, normal] = [geometry.position(point), geometry.normal(point)]
                .map(|vector| DVec3::from(vector.map(f64::from)));
            (position, normal, f64::from(values[point]) / 255.0)
        });
        let place = (DVec3::from(position.map(f64::from)), DVec3::from(normal.map(f64::from)));
        let r = f64::from(kernel_radius);
        let wanted = reference(all, place, r, Margins { straight: 1e-3, away: 1e-3 * r });
        if !wanted.near_threshold {
            prop_assert_eq!(many[0].is_some(), wanted.blended > 0);
            prop_assert!((f64::from(many[0].unwrap_or(1.0)) - wanted.ao).abs() < 2e-4);
        }
    }
}

#[test]
fn what_has_not_come_has_no_value() {
    let all = surface_state(0.5, &[vec![(Vec3::ZERO, Vec3::Y)]], &[0, 0], |instance, _| instance as u8 * 51);
    let nothing = surface::State::new(Arc::clone(all.layout()));
    let mut sampler = AoSampler::new();
    let ask = |sampler: &AoSampler, state: &surface::State, instance| {
        let (position, normal) = ([0.0; 3], [0.0, 1.0, 0.0]);
        let mut many = [Some(0.5)];
        let known = sampler.ao_many(state, instance, &[position], &[normal], &mut many).is_ok();
        let one = sampler.ao(state, instance, position, normal);
        assert!(!known || many == [one]);
        one
    };
    sampler.prepare(&nothing);
    assert_eq!(ask(&sampler, &nothing, 0), None);
    assert_eq!(ask(&sampler, &all, 0), None, "its geometry came after the sampler was prepared");
    sampler.prepare(&all);
    assert_eq!([0, 1, 2].map(|instance| ask(&sampler, &all, instance)), [Some(0.0), Some(0.2), None]);
    assert_eq!(ask(&sampler, &nothing, 0), None, "an index serves its own geometry alone");
    assert!(sampler.heap_bytes() > 0);
}

#[test]
fn slices_and_instances_that_do_not_fit_are_errors_and_nothing_is_written() {
    let surface = surface_state(0.5, &[vec![(Vec3::ZERO, Vec3::Y)]], &[0], |_, _| 0);
    let grid = Grid::new([0.0; 3], 1.0, [2; 3]).unwrap();
    let points = vec![PointSample { local: [1.0; 3], normal: [0.0, 0.0, 1.0], ao: 51 }];
    let cells = state(&[TestInstance { grid, kernel_radius: 0.5, pose: Pose::IDENTITY, points }]);
    let sampler = AoSampler::new();
    for state in [StateRef::from(&surface), StateRef::from(&cells)] {
        let mut out = [Some(0.5)];
        let short = sampler.ao_many(state, 0, &[[0.0; 3]], &[], &mut out);
        assert_eq!(short, Err(SampleError::Lengths { positions: 1, normals: 0, out: 1 }));
        let unknown = sampler.ao_many(state, 7, &[[0.0; 3]], &[[0.0; 3]], &mut out);
        assert_eq!(unknown, Err(SampleError::Instance { instance: 7, instances: 1 }));
        assert_eq!(out, [Some(0.5)]);
    }
    assert_eq!(sampler.ao(&cells, 0, [1.0; 3], [0.0, 0.0, 1.0]), Some(0.2));
    assert_eq!(sampler.ao(&cells, 1, [1.0; 3], [0.0, 0.0, 1.0]), None);
}
