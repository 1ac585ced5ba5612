//! Views of streams of profile `paper`.

use glam::{Quat, Vec3};
use proptest::prelude::*;
use psao_codec::paper::PointFormat;
use psao_codec::paper::{Grid, PointSample};
use psao_codec::paper::{Pose, State};

use super::{Bounds, check, on_one_thread, row};
use crate::reconstruct::cells::WorldToLocal;
use crate::reconstruct::{ReconstructError, Statistics, cells};
use crate::testing::{Margins, Reference, TestInstance, reference, state, state_of, unit};
use crate::{AoSampler, GBuffer, Place, Size, Surface};

fn fragment(instance: u32, position: Vec3, normal: Vec3) -> Surface {
    Surface { t: 1.0, position, normal, instance, rest: None }
}

fn point(local: [f32; 3], ao: u8) -> PointSample {
    PointSample { local, normal: [0.0, 0.0, 1.0], ao }
}

fn grid() -> Grid {
    Grid::new([0.0; 3], 1.0, [4, 4, 4]).unwrap()
}

fn one(points: Vec<PointSample>) -> State {
    state(&[TestInstance { grid: grid(), kernel_radius: 0.5, pose: Pose::IDENTITY, points }])
}

/// Computes Eq. 2 to 4 over every point of the instance whose cell is one of the two nearest on each axis.
fn brute_force(state: &State, fragment: &Surface) -> Reference {
    let layout = state.layout().instances()[fragment.instance as usize];
    let pose = state.pose(fragment.instance).unwrap();
    let rotation = glam::Mat3::from_quat(Quat::from_array(pose.rotation));
    let x = rotation.transpose() * (fragment.position - Vec3::from(pose.translation));
    let n_x = (rotation.transpose() * fragment.normal).as_dvec3();
    let in_cells = (x - Vec3::from(layout.grid.origin())) / layout.grid.edge();
    let [width, height, depth] = layout.grid.dims();
    let all = (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
    let near = all.filter(|cell| {
        // The two nearest cell centres lie within one cell on each axis.
        let off = in_cells - 0.5 - Vec3::from(cell.map(|axis| axis as f32));
        off.to_array().iter().all(|o| (-1.0..1.0).contains(o))
    });
    let points = near.flat_map(|cell| {
        let corner = Vec3::from(layout.grid.corner(cell));
        let points = state.lookup(fragment.instance, cell).into_iter();
        points.flat_map(|cell| cell.points(state.layout().format())).map(move |point| {
            let position = corner + Vec3::from(point.frac) * layout.grid.edge();
            (position.as_dvec3(), Vec3::from(point.normal).as_dvec3(), f64::from(point.accessibility()))
        })
    });
    let margins = Margins { straight: 1e-4, away: 1e-4 };
    reference(points, (x.as_dvec3(), n_x), layout.kernel_radius.into(), margins)
}

#[test]
fn two_points_are_blended_by_distance() {
    // Positions on the 1/31 lattice of their cells, so that packing keeps them.
    let [a, b] = [15.0 / 31.0, 23.0 / 31.0];
    let state = one(vec![point([a, 0.0, 0.0], 255), point([b, 0.0, 0.0], 0)]);
    let x = a + 2.0 / 31.0;
    let found = cells(&state, &row(&[fragment(0, Vec3::new(x, 0.0, 0.0), Vec3::Z)])).unwrap();
    let (near, far) = (1.0 - 2.0 / 31.0 / 0.5, 1.0 - 6.0 / 31.0 / 0.5);
    assert!((found.image.values()[0] - near / (near + far)).abs() < 1e-5, "{found:?}");
    assert_eq!(found.statistics, Statistics { fragments: 1, unsupported: 0, blended: 2 });
    assert_eq!(found.statistics.mean_blended(), 2.0);
}

#[test]
fn a_point_at_the_fragment_counts_in_full() {
    let state = one(vec![point([1.0, 1.0, 1.0], 51)]);
    // Eq. 3 discards points straight along the normal; at distance 0 there is no direction.
    let found = cells(&state, &row(&[fragment(0, Vec3::ONE, Vec3::Z)])).unwrap();
    assert_eq!(found.image.values(), [0.2]);
    let above = fragment(0, Vec3::new(1.0, 1.0, 1.01), Vec3::Z);
    assert_eq!(cells(&state, &row(&[above])).unwrap().image.values(), [1.0]);
}

#[test]
fn background_and_unsupported_fragments_are_open() {
    let state = one(vec![point([0.5, 0.5, 0.5], 0)]);
    let size = Size::new(4, 1).unwrap();
    let fragments = [
        None,
        Some(fragment(0, Vec3::new(3.5, 3.5, 3.5), Vec3::Z)),
        Some(fragment(0, Vec3::new(0.5, 0.5, 0.5), Vec3::NEG_Z)),
        Some(fragment(0, Vec3::new(1e30, f32::NAN, f32::INFINITY), Vec3::Z)),
    ];
    let view = GBuffer::from_fragments(size, fragments.to_vec()).unwrap();
    let found = cells(&state, &view).unwrap();
    assert_eq!(found.image.values(), [1.0; 4]);
    assert_eq!(found.statistics, Statistics { fragments: 3, unsupported: 3, blended: 0 });
    assert_eq!(found.statistics.unsupported_share(), 1.0);
    assert_eq!(Statistics::default().mean_blended(), 0.0);
}

#[test]
fn fragments_outside_the_grid_still_find_the_cells_at_its_rim() {
    let state = one(vec![point([0.0, 0.5, 0.5], 102), point([4.0, 3.5, 3.5], 204)]);
    let fragments = [
        fragment(0, Vec3::new(-0.25, 0.5, 0.5), Vec3::Z),
        fragment(0, Vec3::new(4.25, 3.5, 3.5), Vec3::Z),
        fragment(0, Vec3::new(-0.75, 0.5, 0.5), Vec3::Z),
    ];
    let values = cells(&state, &row(&fragments)).unwrap();
    assert_eq!(values.image.values(), [0.4, 0.8, 1.0]);
}

#[test]
fn the_servers_pose_moves_the_points() {
    let pose = Pose { translation: [10.0, 20.0, 30.0], rotation: [0.0, 0.0, 0.5_f32.sqrt(), 0.5_f32.sqrt()] };
    let points = vec![point([1.0, 2.0, 3.0], 51)];
    let state = state(&[
        TestInstance { grid: grid(), kernel_radius: 0.5, pose: Pose::IDENTITY, points: vec![] },
        TestInstance { grid: grid(), kernel_radius: 0.5, pose, points },
    ]);
    // A quarter turn about z takes (1, 2, 3) to (-2, 1, 3).
    let moved = fragment(1, Vec3::new(8.1, 21.0, 33.0), Vec3::Z);
    let there = cells(&state, &row(&[moved, fragment(0, Vec3::new(1.1, 2.0, 3.0), Vec3::Z)])).unwrap();
    assert_eq!(there.image.values(), [0.2, 1.0], "points belong to their own instance");
}

#[test]
fn an_unknown_instance_is_an_error() {
    let state = one(vec![]);
    let view = row(&[fragment(0, Vec3::ZERO, Vec3::Z), fragment(1, Vec3::ZERO, Vec3::Z)]);
    let error = cells(&state, &view).unwrap_err();
    assert_eq!(error, ReconstructError::Instance { pixel: 1, instance: 1, instances: 1 });
    assert!(error.to_string().contains("draw the scene"));
}

fn sample() -> impl Strategy<Value = PointSample> {
    (prop::array::uniform3(-0.4_f32..0.9), unit(), any::<u8>()).prop_map(|(local, normal, ao)| PointSample {
        local,
        normal: normal.to_array(),
        ao,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn fast_path_and_brute_force_agree(
        points in prop::collection::vec(sample(), 0..200),
        more in prop::collection::vec(sample(), 0..50),
        fragments in prop::collection::vec((0_u32..2, prop::array::uniform3(-0.6_f32..1.1), unit()), 1..80),
        translation in prop::array::uniform3(-3.0_f32..3.0),
        (axis, angle) in (unit(), -3.0_f32..3.0),
        kernel_radius in 0.05_f32..0.6,
        width in 1_usize..10,
        format in prop::sample::select(PointFormat::ALL.to_vec()),
    ) {
        let grid = Grid::new([-0.4; 3], 0.26, [5, 4, 5]).unwrap();
        let rotation = Quat::from_axis_angle(axis, angle);
        let pose = Pose { translation, rotation: rotation.to_array() };
        let state = state_of(format, &[
            TestInstance { grid, kernel_radius, pose, points },
            TestInstance { grid, kernel_radius, pose: Pose::IDENTITY, points: more },
        ]);
        let mut pixels: Vec<_> = fragments.iter().map(|&(instance, local, normal)| {
            // Some fragments lie in the local space of the moved instance, so that both instances have points near.
            let position = if instance == 0 { rotation * Vec3::from(local) + Vec3::from(translation) } else { local.into() };
            Some(fragment(instance, position, normal))
        }).collect();
        pixels.resize(pixels.len().next_multiple_of(width), None);
        let size = Size::new(u32::try_from(width).unwrap(), u32::try_from(pixels.len() / width).unwrap()).unwrap();
        let view = GBuffer::from_fragments(size, pixels).unwrap();
        let found = cells(&state, &view).unwrap();
        check(&found, &view, Bounds { value: 2e-5, near_thresholds: 10 }, |fragment| brute_force(&state, fragment))?;
        prop_assert_eq!(on_one_thread(|| cells(&state, &view).unwrap()), found.clone());
        // The sampler returns bit-identical values for the same places.
        let sampler = AoSampler::new();
        for (pixel, &value) in found.image.values().iter().enumerate() {
            let Some(fragment) = view.fragment(pixel) else { continue };
            let to_local = WorldToLocal::new(state.pose(fragment.instance).unwrap());
            let position = to_local.point(fragment.position).to_array();
            let normal = to_local.vector(fragment.normal).to_array();
            let place = Place { position, normal, chart: 9, spacing: 0.0 };
            let ao = sampler.ao(&state, fragment.instance, &place);
            prop_assert_eq!(ao.unwrap_or(1.0).to_bits(), value.to_bits());
            let mut many = [None];
            sampler.ao_many(&state, fragment.instance, &[place], &mut many).unwrap();
            prop_assert_eq!(many, [ao]);
        }
    }

    #[test]
    fn points_of_one_value_give_that_value(
        places in prop::collection::vec(prop::array::uniform3(0.0_f32..4.0), 1..100),
        ao: u8,
        at in prop::array::uniform3(0.0_f32..4.0),
    ) {
        let state = one(places.into_iter().map(|local| point(local, ao)).collect());
        let found = cells(&state, &row(&[fragment(0, at.into(), Vec3::Z)])).unwrap();
        let want = if found.statistics.unsupported == 1 { 1.0 } else { f32::from(ao) / 255.0 };
        prop_assert!((found.image.values()[0] - want).abs() < 1e-6);
    }
}
