//! Ambient occlusion of every fragment from cells of points (paper, section 3.5, Eq. 2 to 4).

use psao_codec::paper::State;

use super::blend::{Blend, Place};
use super::neighbours::{InstanceSpace, Neighbours};
use super::outcome::{ReconstructError, Reconstruction};
use super::walk::{check_instances, walk};
use crate::GBuffer;

/// Reconstructs the ambient occlusion of every fragment of `view` from the points of `state`.
///
/// For each fragment: its position and normal go into the local space of its instance with the pose that the
/// server sent last; the points of the 2 x 2 x 2 cells nearest to it, at most 56, are weighted by Eq. 2 and 3
/// ([`weight`](super::weight())); Eq. 4 is their weighted mean, or 1 if no weight is above 0. Background is 1.
///
/// Rows are spread over all cores; the result does not depend on how many there are.
///
/// # Errors
///
/// [`ReconstructError::Instance`] when a fragment shows an instance beyond the stream's layout.
pub fn cells(state: &State, view: &GBuffer) -> Result<Reconstruction, ReconstructError> {
    let spaces = InstanceSpace::all(state);
    check_instances(view, spaces.len())?;
    Ok(walk(view, Neighbours::new, |neighbours, pixel, instance| {
        let space = &spaces[instance as usize];
        let place = Place {
            position: space.local_point(view.position()[pixel]),
            normal: space.local_vector(view.normal()[pixel]),
            radius: space.kernel_radius(),
        };
        let mut blend = Blend::new();
        if let Some(base) = space.base(place.position) {
            for group in neighbours.of(state, space, base) {
                blend.add(group, &place);
            }
        }
        blend
    }))
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};
    use proptest::prelude::*;
    use psao_codec::paper::{Grid, PointFormat, PointSample, Pose};

    use super::*;
    use crate::reconstruct::Statistics;
    use crate::testing::{TestInstance, state, state_of};
    use crate::{Size, Surface};

    /// A view of one row of fragments.
    fn row(fragments: &[Surface]) -> GBuffer {
        let size = Size::new(u32::try_from(fragments.len()).unwrap(), 1).unwrap();
        GBuffer::from_fragments(size, fragments.iter().copied().map(Some).collect()).unwrap()
    }

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

    /// What the twin says of a fragment.
    #[derive(Clone, Copy, Debug)]
    struct Twin {
        ao: f64,
        blended: u64,
        /// A criterion is so near its threshold that rounding may decide it either way.
        close_call: bool,
    }

    /// The slow, obvious twin: every point of the instance, kept when its cell is one of the two nearest on
    /// each axis, weighted by the words of Eq. 2 to 4 in f64.
    fn brute_force(state: &State, fragment: &Surface) -> Twin {
        let layout = state.layout().instances()[fragment.instance as usize];
        let pose = state.pose(fragment.instance).unwrap();
        let rotation = glam::Mat3::from_quat(Quat::from_array(pose.rotation));
        let x = rotation.transpose() * (fragment.position - Vec3::from(pose.translation));
        let n_x = (rotation.transpose() * fragment.normal).as_dvec3();
        let in_cells = (x - Vec3::from(layout.grid.origin())) / layout.grid.edge();
        let [width, height, depth] = layout.grid.dims();
        let all = (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
        let near = all.filter(|cell| {
            // From the cell's centre: the two nearest centres lie within one cell on each axis.
            let off = in_cells - 0.5 - Vec3::from(cell.map(|axis| axis as f32));
            off.to_array().iter().all(|o| (-1.0..1.0).contains(o))
        });
        let (mut sum, mut weighted, mut blended, mut close_call) = (0.0, 0.0, 0, false);
        for cell in near {
            let corner = Vec3::from(layout.grid.corner(cell));
            for point in state
                .lookup(fragment.instance, cell)
                .into_iter()
                .flat_map(|cell| cell.points(state.layout().format()))
            {
                let p = (corner + Vec3::from(point.frac) * layout.grid.edge()).as_dvec3();
                let n_p = Vec3::from(point.normal).as_dvec3();
                let (x, r) = (x.as_dvec3(), f64::from(layout.kernel_radius));
                let mut alpha = ((r - (p - x).length()) / r).max(0.0);
                close_call |= ((r - (p - x).length()) / r).abs() < 1e-5;
                close_call |= (n_p.dot(n_x) - 0.1).abs() < 1e-5;
                if n_p.dot(n_x) <= 0.1 {
                    alpha = 0.0;
                }
                if p != x {
                    let square = n_p.dot((p - x) / (p - x).length()).powi(2);
                    close_call |= (square - 0.7).abs() < 1e-4 || (p - x).length() < 1e-4;
                    if square >= 0.7 {
                        alpha = 0.0;
                    }
                }
                sum += alpha;
                weighted += alpha * f64::from(point.accessibility());
                blended += u64::from(alpha > 0.0);
            }
        }
        Twin { ao: if sum == 0.0 { 1.0 } else { weighted / sum }, blended, close_call }
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
        // Straight along the normal is what Eq. 3 throws out; at distance 0 there is no direction to judge.
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
        let pose =
            Pose { translation: [10.0, 20.0, 30.0], rotation: [0.0, 0.0, 0.5_f32.sqrt(), 0.5_f32.sqrt()] };
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

    fn unit() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0_f32..1.0)
            .prop_map(Vec3::from)
            .prop_filter("has a direction", |v| v.length() > 0.1)
            .prop_map(Vec3::normalize)
    }

    fn sample() -> impl Strategy<Value = PointSample> {
        (prop::array::uniform3(-0.4_f32..0.9), unit(), any::<u8>())
            .prop_map(|(local, normal, ao)| PointSample { local, normal: normal.to_array(), ao })
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
                // Some fragments in the local space of the moved instance, so that both find points.
                let position = if instance == 0 { rotation * Vec3::from(local) + Vec3::from(translation) } else { local.into() };
                Some(fragment(instance, position, normal))
            }).collect();
            pixels.resize(pixels.len().next_multiple_of(width), None);
            let size = Size::new(u32::try_from(width).unwrap(), u32::try_from(pixels.len() / width).unwrap()).unwrap();
            let view = GBuffer::from_fragments(size, pixels).unwrap();
            let found = cells(&state, &view).unwrap();
            let mut sum = Statistics::default();
            let mut close_calls = 0;
            for (pixel, &value) in found.image.values().iter().enumerate() {
                let Some(fragment) = view.fragment(pixel) else {
                    prop_assert_eq!(value, 1.0);
                    continue;
                };
                let twin = brute_force(&state, &fragment);
                close_calls += u64::from(twin.close_call);
                prop_assert!(twin.close_call || (f64::from(value) - twin.ao).abs() < 2e-5, "{} {:?}", value, twin);
                sum = sum.plus(Statistics {
                    fragments: 1,
                    unsupported: u64::from(twin.blended == 0),
                    blended: twin.blended,
                });
            }
            prop_assert!(close_calls * 10 <= sum.fragments + 9, "{} close calls", close_calls);
            if close_calls == 0 {
                prop_assert_eq!(found.statistics, sum);
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            prop_assert_eq!(pool.install(|| cells(&state, &view).unwrap()), found);
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
}
