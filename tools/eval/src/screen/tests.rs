//! Tests of properties that all methods share, on scenes with known results.

use std::sync::Arc;

use glam::Vec3;
use psao_proto::message::CameraPose;
use psao_reconstruct::{AoImage, Camera, Size, Surface, Surfaces, cast_view};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;

use super::*;
use crate::adapter::SceneView;
use crate::metric::mae;
use crate::reference::reference;
use crate::sweep::screen_methods;

/// Infinite planes, each a point and a normal.
struct Planes(Vec<[Vec3; 2]>);

impl Surfaces for Planes {
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface> {
        let hits = self.0.iter().filter_map(|&[point, normal]| {
            let t = (point - origin).dot(normal) / dir.dot(normal);
            let position = origin + dir * t;
            (t > 0.0 && t < tmax).then_some(Surface { t, position, normal, instance: 0, rest: None })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }
}

fn size(width: u32, height: u32) -> Size {
    Size::new(width, height).unwrap()
}

fn pose(eye: [f32; 3], target: [f32; 3], up: [f32; 3]) -> CameraPose {
    CameraPose { eye, target, up, fov_y_deg: 50.0, aspect: 1.5 }
}

/// Returns a floor on y = 0 and a wall on z = 0, which both face the eye at about 45 degrees.
fn corner(up: [f32; 3], guard: u32) -> Screen {
    let planes = Planes(vec![[Vec3::ZERO, Vec3::Y], [Vec3::ZERO, Vec3::Z]]);
    Screen::new(&planes, &pose([0.0, 1.5, 1.6], [0.0; 3], up), size(120, 80), guard).unwrap()
}

/// Returns all methods for a radius.
fn all(radius: f32) -> Vec<Box<dyn ScreenMethod>> {
    vec![
        Box::new(ScreenRays { rays: 16, ..ScreenRays::new(radius) }),
        Box::new(Ssao { doubled: true, ..Ssao::new(radius) }),
        Box::new(SsaoPlus::new(radius)),
        Box::new(Hbao::new(radius)),
        Box::new(PyramidHbao::new(radius)),
        Box::new(Scalable::new(radius)),
        Box::new(LineSweep::new(radius)),
    ]
}

/// Returns every measured method with every setting.
fn every() -> Vec<Box<dyn ScreenMethod>> {
    screen_methods(&AoSettings::default().with_radius(0.6)).unwrap()
}

fn shade(method: &dyn ScreenMethod, screen: &Screen) -> Shading {
    method.shade(screen, &NoClock).unwrap()
}

fn mean(image: &AoImage) -> f32 {
    image.values().iter().sum::<f32>() / image.values().len() as f32
}

#[test]
fn names_and_labels_are_all_different() {
    let methods = all(0.6);
    let mut names: Vec<_> = methods.iter().flat_map(|m| [m.name().to_owned(), m.label()]).collect();
    assert!(methods.iter().all(|m| m.name().chars().all(|c| c.is_ascii_lowercase() || c == '-')));
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), 2 * methods.len());
}

#[test]
fn a_plane_is_open() {
    let floor = Planes(vec![[Vec3::ZERO, Vec3::Y]]);
    let straight = Planes(vec![[Vec3::new(0.0, 0.0, -3.0), Vec3::Z]]);
    let slanted = pose([0.0, 1.2, 2.0], [0.0; 3], [0.0, 1.0, 0.0]);
    let ahead = pose([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
    for (planes, pose) in [(&floor, slanted), (&straight, ahead)] {
        let screen = Screen::new(planes, &pose, size(96, 64), 16).unwrap();
        for method in all(0.6) {
            let found = shade(&*method, &screen);
            // A slanted plane divides the points of a sphere unevenly. All other methods know the plane by its normal.
            // So do points near the rim of a hemisphere, where a pixel spans more depth than the bias.
            let (least, average) = match method.name() {
                "ssao" => (0.6, 0.9),
                "ssao-plus" => (0.9, 0.99),
                _ => (0.999, 0.999),
            };
            let darkest = found.image.values().iter().copied().fold(1.0, f32::min);
            assert!(darkest >= least, "{}: {darkest}", method.name());
            assert!(mean(&found.image) >= average, "{}: {}", method.name(), mean(&found.image));
        }
        // As published, half of the sphere is behind any plane.
        let plain = shade(&Ssao::new(0.6), &screen).image;
        assert!((mean(&plain) - 0.5).abs() < 0.1, "{}", mean(&plain));
    }
}

/// Returns the mean accessibility in the given sixth of a radius from an infinite wall at a right angle.
fn in_sixth(sixth: usize, falloff: &Falloff) -> f64 {
    let places = (0..8).map(|place| (sixth as f64 + (f64::from(place) + 0.5) / 8.0) / 6.0);
    places.map(|away| beside_a_wall(away, falloff)).sum::<f64>() / 8.0
}

/// Computes the accessibility `away` radii from such a wall by quadrature.
fn beside_a_wall(away: f64, falloff: &Falloff) -> f64 {
    let (steps, mut hidden) = (200, 0.0);
    for i in 0..steps {
        for j in 0..steps {
            let across = ((f64::from(i) + 0.5) / f64::from(steps)).sqrt();
            let turn = (f64::from(j) + 0.5) / f64::from(steps) * std::f64::consts::TAU;
            let towards = across * turn.cos();
            if towards > 0.0 {
                hidden += f64::from(falloff.weight((away / towards) as f32));
            }
        }
    }
    1.0 - hidden / f64::from(steps * steps)
}

/// Returns the mean accessibility of the floor of [`corner`] in `image`, upright, in sixths of a radius from the wall.
fn away_from_the_wall(image: &AoImage, radius: f32) -> [f64; 6] {
    let camera = Camera::new(&pose([0.0, 1.5, 1.6], [0.0; 3], [0.0, 1.0, 0.0])).unwrap();
    let mut bins = [(0.0, 0); 6];
    for (x, y) in (40..80).flat_map(|x| (0..80).map(move |y| (x, y))) {
        let ray = camera.ray(size(120, 80), x, y);
        let at = ray.origin + ray.direction * (-ray.origin.y / ray.direction.y);
        if ray.direction.y < 0.0 && at.z > 0.0 && at.z < radius {
            let bin = &mut bins[(at.z / radius * 6.0) as usize];
            bin.0 += f64::from(image.get(x, y).unwrap());
            bin.1 += 1;
        }
    }
    assert!(bins.iter().all(|bin| bin.1 > 50));
    bins.map(|(found, count)| found / f64::from(count))
}

#[test]
fn a_corner_darkens_towards_its_edge_and_comes_near_the_truth() {
    let screen = corner([0.0, 1.0, 0.0], 40);
    for method in all(0.6) {
        // Rays only have noise. A single occluder for each direction hides too little near the edge. Scalable has a
        // different formula, HBAO no cosine, and SSAO no normal.
        let bound = match method.name() {
            "traced" => 0.015,
            "ssao-plus" | "hbao" => 0.07,
            "ssao" => 0.09,
            _ => 0.15,
        };
        let mut before = 0.0;
        for (sixth, found) in away_from_the_wall(&shade(&*method, &screen).image, 0.6).into_iter().enumerate()
        {
            let truth = in_sixth(sixth, &Falloff::Linear);
            assert!((found - truth).abs() < bound, "{} at {sixth}: {found}, not {truth}", method.name());
            assert!(found > before - 0.01, "{}: {found} after {before}", method.name());
            before = found;
        }
    }
}

#[test]
fn rays_find_the_truth_for_every_falloff() {
    let screen = corner([0.0, 1.0, 0.0], 40);
    let sampled = Falloff::sampled(&[1.0, 0.9, 0.2, 0.1]).unwrap();
    let exponential = Falloff::Exponential { decay: 3.0 };
    for falloff in [Falloff::Binary, Falloff::Quadratic, Falloff::Cubic, exponential, sampled] {
        let method = ScreenRays { rays: 64, falloff: falloff.clone(), ..ScreenRays::new(0.6) };
        for (sixth, found) in away_from_the_wall(&shade(&method, &screen).image, 0.6).into_iter().enumerate()
        {
            let truth = in_sixth(sixth, &falloff);
            assert!((found - truth).abs() < 0.015, "{falloff:?} at {sixth}: {found}, not {truth}");
        }
    }
}

#[test]
fn without_jitter_and_blur_what_is_alike_is_shaded_alike() {
    let screen = corner([0.0, 1.0, 0.0], 40);
    let method = Hbao { jitter: false, blur: Blur::NONE, ..Hbao::new(0.6) };
    let spread = |method: &Hbao| {
        let image = shade(method, &screen).image;
        // Along the edge, which crosses the picture.
        let row = (50..70).map(|x| image.get(x, 44).unwrap());
        row.clone().fold(0.0, f32::max) - row.fold(1.0, f32::min)
    };
    assert!(spread(&method) < 0.02, "{}", spread(&method));
    let noisy = Hbao { jitter: true, ..method };
    assert!(spread(&noisy) > 0.02, "{}", spread(&noisy));
}

#[test]
fn sky_is_open_and_hides_nothing() {
    let size = size(24, 16);
    let sky =
        Screen::from_parts(size, 2, [1.0, 0.7], vec![f32::INFINITY; 28 * 20], vec![Vec3::ZERO; 28 * 20]);
    let all_sky = sky.unwrap();
    // A single plate in front of the sky.
    let depth = (0..28 * 20).map(|i| if (5..20).contains(&(i % 28)) { 2.0 } else { f32::INFINITY }).collect();
    let plate = Screen::from_parts(size, 2, [1.0, 0.7], depth, vec![Vec3::NEG_Z; 28 * 20]).unwrap();
    for method in every() {
        assert_eq!(shade(&*method, &all_sky).image.values(), vec![1.0; 24 * 16], "{}", method.label());
    }
    for method in all(0.6) {
        let image = shade(&*method, &plate).image;
        assert!((0..16).all(|y| image.get(0, y) == Some(1.0) && image.get(23, y) == Some(1.0)));
        let darkest = image.values().iter().copied().fold(1.0, f32::min);
        // The points of a sphere are even only on average.
        let least = if method.name() == "ssao" { 0.8 } else { 0.99 };
        assert!(darkest >= least, "{}: {darkest}", method.name());
    }
}

#[test]
fn single_pixels_and_guard_bands_of_any_width_are_fine() {
    let planes = Planes(vec![[Vec3::ZERO, Vec3::Y], [Vec3::ZERO, Vec3::Z]]);
    let pose = pose([0.0, 1.0, 1.1], [0.0; 3], [0.0, 1.0, 0.0]);
    for guard in [0, 1, 50] {
        for size in [size(1, 1), size(1, 9), size(9, 1)] {
            let screen = Screen::new(&planes, &pose, size, guard).unwrap();
            for method in every() {
                let found = shade(&*method, &screen);
                assert_eq!(found.image.size(), size, "{}", method.name());
                assert!(found.bytes >= size.pixels() * 4);
            }
        }
    }
}

#[test]
fn a_guard_band_shows_what_is_beside_the_image() {
    // Views with and without a guard band differ at the sides; the one with it is darker.
    let [bare, guarded] = [0, 40].map(|guard| corner([1.0, 0.0, 0.0], guard));
    for method in all(0.6) {
        let [bare, guarded] = [&bare, &guarded].map(|screen| shade(&*method, screen).image);
        // The points of a sphere that leave the screen may be the hidden ones.
        let darker = mean(&guarded) < mean(&bare) + 0.002 || method.name() == "ssao";
        assert!(darker, "{}: {} {}", method.name(), mean(&guarded), mean(&bare));
        assert_ne!(bare, guarded, "{}", method.name());
    }
}

#[test]
fn radii_that_are_none_are_refused_by_all() {
    let screen = corner([0.0, 1.0, 0.0], 0);
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e30] {
        for method in all(radius) {
            let found = method.shade(&screen, &NoClock);
            assert!(
                matches!(found, Err(ScreenError::Radius { .. })),
                "{} {radius}: {found:?}",
                method.name()
            );
        }
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let screen = corner([0.0, 1.0, 0.0], 0);
    let rising = Falloff::Exponential { decay: -1.0 };
    let (ssao, plus, hbao) = (Ssao::new(0.6), SsaoPlus::new(0.6), Hbao::new(0.6));
    let (pyramid, scalable, sweep) = (PyramidHbao::new(0.6), Scalable::new(0.6), LineSweep::new(0.6));
    let traced = ScreenRays::new(0.6);
    let bad: Vec<Box<dyn ScreenMethod>> = vec![
        Box::new(Ssao { points: 0, ..ssao.clone() }),
        Box::new(Ssao { falloff: rising.clone(), ..ssao }),
        Box::new(SsaoPlus { points: 1025, ..plus.clone() }),
        Box::new(SsaoPlus { bias: f32::NAN, ..plus }),
        Box::new(Hbao { directions: 0, ..hbao.clone() }),
        Box::new(Hbao { steps: 0, ..hbao.clone() }),
        Box::new(Hbao { angle_bias_deg: 90.0, ..hbao }),
        Box::new(PyramidHbao { levels: 9, ..pyramid.clone() }),
        Box::new(PyramidHbao { step_px: 0.0, ..pyramid }),
        Box::new(Scalable { taps: 0, ..scalable.clone() }),
        Box::new(Scalable { blur: Blur { sigma: -1.0, ..scalable.blur }, ..scalable }),
        Box::new(LineSweep { directions: 0, ..sweep.clone() }),
        Box::new(LineSweep { directions: 7, ..sweep.clone() }),
        Box::new(LineSweep { directions: 258, ..sweep.clone() }),
        Box::new(LineSweep { falloff: rising, ..sweep }),
        Box::new(ScreenRays { rays: 0, ..traced.clone() }),
        Box::new(ScreenRays { thickness: Some(0.0), ..traced.clone() }),
        Box::new(ScreenRays { step_px: f32::NAN, ..traced.clone() }),
        Box::new(ScreenRays { bias: RayBias::OfDepth(0.5), ..traced }),
    ];
    for method in bad {
        let found = method.shade(&screen, &NoClock);
        let refused = matches!(found, Err(ScreenError::Setting { .. } | ScreenError::Falloff { .. }));
        assert!(refused, "{}: {:?}", method.label(), found.map(|shaded| shaded.bytes));
    }
}

#[test]
fn one_thread_and_four_shade_the_same() {
    let screen = corner([0.3, 1.0, 0.0], 8);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    for method in all(0.6) {
        let [one, four] = [1, 4].map(|threads| pool(threads).install(|| shade(&*method, &screen)));
        assert_eq!(one, four, "{}", method.name());
        assert_eq!(shade(&*method, &screen), one, "{}: again", method.name());
    }
}

#[test]
fn turning_the_camera_about_its_axis_changes_little() {
    // The pixels are square, so that the disc in the middle of the picture looks the same.
    let middle = |image: &AoImage| {
        let disc = |x: i32, y: i32| (x - 60).pow(2) + (y - 40).pow(2) < 38 * 38;
        let inside = (0..120).flat_map(|x| (0..80).map(move |y| (x, y))).filter(|&(x, y)| disc(x, y));
        let values: Vec<f32> = inside.map(|(x, y)| image.get(x as u32, y as u32).unwrap()).collect();
        values.iter().sum::<f32>() / values.len() as f32
    };
    let ups = [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-0.2, -1.0, 0.0]];
    let screens = ups.map(|up| corner(up, 40));
    for method in all(0.6) {
        let means = [0, 1, 2, 3].map(|turn| middle(&shade(&*method, &screens[turn]).image));
        let (least, most) = means.iter().fold((1.0_f32, 0.0_f32), |(a, b), &m| (a.min(m), b.max(m)));
        assert!(most - least < 0.012, "{}: {means:?}", method.name());
    }
}

#[test]
fn stages_take_the_time_that_the_clock_says() {
    /// A clock that advances by 10 us at each reading.
    struct Ticks(std::cell::Cell<u64>);
    impl Clock for Ticks {
        fn micros(&self) -> u64 {
            self.0.set(self.0.get() + 10);
            self.0.get()
        }
    }
    let screen = corner([0.0, 1.0, 0.0], 0);
    for method in all(0.1) {
        let shaded = method.shade(&screen, &Ticks(0.into())).unwrap();
        assert!(shaded.stages.iter().all(|(_, micros)| *micros == 10), "{:?}", shaded.stages);
        assert_eq!(shaded.micros(), 10 * shaded.stages.len() as u64);
    }
}

#[test]
fn on_a_built_in_scene_each_is_as_far_from_the_reference_as_it_should_be() {
    let scene = Arc::new(Scene::load("colonnade").unwrap());
    let world = SceneBvh::new(&scene, &scene.pose(1.0));
    let view = SceneView::new(&world);
    let (camera, size) = (scene.camera(1.0), size(160, 90));
    let fragments = cast_view(&view, &camera, size).unwrap();
    let truth = reference(&view, &fragments, &AoSettings::default()).unwrap();
    let screen = Screen::new(&view, &camera, size, 16).unwrap();
    for method in all(0.6) {
        let found = mae(&truth, &shade(&*method, &screen).image).unwrap();
        let bound = match method.name() {
            // Surfaces are infinitely thick, so there are halos behind every outline.
            "traced" => 0.09,
            "line-sweep" => 0.04,
            "ssao-plus" => 0.05,
            _ => 0.07,
        };
        assert!(found < bound, "{}: {found}", method.name());
    }
}
