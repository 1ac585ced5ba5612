use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;
use psao_codec::paper::Pose;
use psao_codec::paper::{Grid, PointSample};

use super::*;
use crate::testing::{TestInstance, chart_of, fit_reference, points, state, surface_state, unit};

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
        let place = |place: &&([f32; 3], Vec3)| Place {
            position: place.0,
            normal: place.1.to_array(),
            chart: chart_of(place.1),
            spacing: 0.0,
        };
        let places: Vec<Place> = places.iter().map(place).collect();
        let mut many = vec![Some(-1.0); places.len()];
        sampler.ao_many(&state, instance, &places, &mut many).unwrap();
        for (place, many) in places.iter().zip(&many) {
            let one = sampler.ao(&state, instance, place);
            prop_assert_eq!(one.map(f32::to_bits), many.map(f32::to_bits));
        }
        let geometry = state.geometry(state.layout().members()[instance as usize].set).unwrap();
        let Place { position, normal, chart, .. } = places[0];
        let values = state.values(instance);
        let own = (0..geometry.len()).filter(|&point| geometry.chart(point) == chart && values[point] != 0);
        let all = own.map(|point| {
            let [position, normal] = [geometry.position(point), geometry.normal(point)]
                .map(|vector| DVec3::from(vector.map(f64::from)));
            (position, normal, f64::from(values[point]) / 255.0)
        });
        let place = (DVec3::from(position.map(f64::from)), DVec3::from(normal.map(f64::from)));
        let wanted = fit_reference(all, place, kernel_radius.into());
        // With more levels, a coarser one is taken where few points are near.
        if !wanted.near_threshold && geometry.layout().levels.count() == 1 {
            prop_assert_eq!(many[0].is_some(), wanted.blended > 0);
            prop_assert!((f64::from(many[0].unwrap_or(1.0)) - wanted.ao).abs() < 2e-3);
        }
    }
}

#[test]
fn what_has_not_come_has_no_value() {
    let all =
        surface_state(0.5, &[vec![(Vec3::ZERO, Vec3::Y)]], &[0, 0], |instance, _| (1 + instance as u8) * 51);
    let nothing = surface::State::new(Arc::clone(all.layout()));
    let mut sampler = AoSampler::new();
    let ask = |sampler: &AoSampler, state: &surface::State, instance| {
        let place =
            Place { position: [0.0; 3], normal: [0.0, 1.0, 0.0], chart: chart_of(Vec3::Y), spacing: 0.0 };
        let mut many = [Some(0.5)];
        let known = sampler.ao_many(state, instance, &[place], &mut many).is_ok();
        let one = sampler.ao(state, instance, &place);
        assert!(!known || many == [one]);
        one
    };
    sampler.prepare(&nothing);
    assert_eq!(ask(&sampler, &nothing, 0), None);
    assert_eq!(ask(&sampler, &all, 0), None, "its geometry came after the sampler was prepared");
    sampler.prepare(&all);
    assert_eq!([0, 1, 2].map(|instance| ask(&sampler, &all, instance)), [Some(0.2), Some(0.4), None]);
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
        let short = sampler.ao_many(state, 0, &[Place::default(); 2], &mut out);
        assert_eq!(short, Err(SampleError::Lengths { places: 2, out: 1 }));
        let unknown = sampler.ao_many(state, 7, &[Place::default()], &mut out);
        assert_eq!(unknown, Err(SampleError::Instance { instance: 7, instances: 1 }));
        assert_eq!(out, [Some(0.5)]);
    }
    let place = Place { position: [1.0; 3], normal: [0.0, 0.0, 1.0], chart: 0, spacing: 0.0 };
    assert_eq!(sampler.ao(&cells, 0, &place), Some(0.2));
    assert_eq!(sampler.ao(&cells, 1, &place), None);
}
