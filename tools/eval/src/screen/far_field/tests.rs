//! Tests of far-field obscurance against known results, a slow reference and rays.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use proptest::prelude::*;
use psao_reconstruct::{AoImage, Size};
use psao_server::clock::NoClock;
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;

use super::scan::Sense;
use super::slice::{SlabPlacement, Slice};
use super::*;
use crate::adapter::SceneView;
use crate::screen::{Falloff, ScreenRays};

/// Returns the mean difference and the share of pixels at most 5 % off, in per cent, over pixels with a surface
/// (section 8).
fn errors(screen: &Screen, reference: &AoImage, found: &AoImage) -> (f64, f64) {
    let guard = screen.guard() as i32;
    let width = screen.inner().width() as usize;
    let (mut sum, mut within, mut count) = (0.0, 0.0, 0.0);
    for (pixel, (a, b)) in reference.values().iter().zip(found.values()).enumerate() {
        if screen.position((pixel % width) as i32 + guard, (pixel / width) as i32 + guard).is_some() {
            let error = f64::from((a - b).abs());
            sum += error;
            within += f64::from(u8::from(error <= 0.05));
            count += 1.0;
        }
    }
    (100.0 * sum / count, 100.0 * within / count)
}

fn built_in(name: &str, time: f64, inner: Size, guard: u32) -> Screen {
    let scene = Arc::new(Scene::load(name).unwrap());
    let world = SceneBvh::new(&scene, &scene.pose(time));
    Screen::new(&SceneView::new(&world), &scene.camera(time), inner, guard).unwrap()
}

#[test]
fn an_all_hidden_hemisphere_is_one_whatever_the_normal() {
    let table = ObscuranceTable::new(1.0, &Falloff::Binary);
    let estimator = Estimator { table: &table, thickness: None };
    for (position, normal) in [
        (Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z),
        (Vec3::new(2.0, -1.0, 3.0), Vec3::new(0.3, 0.5, -0.7).normalize()),
        (Vec3::new(2.0, -1.0, 3.0), Vec3::new(-0.9, 0.1, -0.2).normalize()),
        (Vec3::new(-2.0, 1.5, 2.0), Vec3::new(-0.5, 0.7, 0.3).normalize()),
    ] {
        let receiver = Receiver::new(position, normal);
        let count = 64;
        let mut sum = 0.0;
        for k in 0..count {
            let angle = std::f32::consts::TAU * k as f32 / count as f32;
            let slice = Slice::new(&receiver, Vec2::new(libm::cosf(angle), libm::sinf(angle)));
            let mut horizon = slice.open();
            // A near slab that begins just before the eye.
            let [across, depth] = slice.axes();
            let z = 1e-4;
            let top = across
                * ((receiver.slope().dot(Vec2::new(libm::cosf(angle), libm::sinf(angle))) + 1e-6) * z)
                + depth * z;
            sum += slice.weight() * estimator.add(&slice, &mut horizon, top, SlabPlacement::Top, 1.0);
        }
        let found = sum * std::f32::consts::TAU / count as f32;
        assert!((found - 1.0).abs() < 0.01, "{position} {normal}: {found}");
    }
}

fn size(width: u32, height: u32) -> Size {
    Size::new(width, height).unwrap()
}

/// Returns a radius and a falloff that reach far over the screens below.
fn settings() -> FarFieldSettings {
    FarFieldSettings {
        radius: 3.0,
        falloff: Falloff::Exponential { decay: 3.0 },
        ..FarFieldSettings::default()
    }
}

/// Returns settings that take different code paths.
fn variants() -> Vec<FarFieldSettings> {
    let base = settings();
    vec![
        FarFieldSettings { sectors: 8, interval: 5, midway: true, ..base.clone() },
        FarFieldSettings { near: None, jitter: Some(3), ..base.clone() },
        FarFieldSettings { thickness: Some(0.3), jitter: Some(7), ..base.clone() },
        FarFieldSettings { sectors: 18, separate: Some(Separation { blur: true }), ..base.clone() },
        FarFieldSettings { near: Some(NearField { growth: 1.5 }), segments: 3, ..base },
    ]
}

fn shade(settings: &FarFieldSettings, screen: &Screen) -> AoImage {
    FarField::new(settings.clone()).unwrap().shade(screen, &NoClock).unwrap().image
}

/// Returns the screen of a camera 90 degrees across and planes, each with its unit normal and its distance behind the
/// eye.
fn planes(inner: Size, guard: u32, planes: &[(Vec3, f32)]) -> Screen {
    let (width, height) = (inner.width() + 2 * guard, inner.height() + 2 * guard);
    let focal = inner.width() as f32 / 2.0;
    let (mut depths, mut normals) = (Vec::new(), Vec::new());
    for y in 0..height {
        for x in 0..width {
            let at = |at: u32, side: u32| (at as f32 + 0.5 - side as f32 / 2.0) / focal;
            let ray = Vec3::new(at(x, width), at(y, height), 1.0);
            let met = planes.iter().map(|(normal, offset)| (-offset / normal.dot(ray), *normal));
            let nearest = met.filter(|(depth, _)| *depth > 0.0).min_by(|a, b| a.0.total_cmp(&b.0));
            let (depth, normal) = nearest.unwrap_or((f32::INFINITY, Vec3::ZERO));
            depths.push(depth);
            normals.push(normal);
        }
    }
    let tangents = [1.0, inner.height() as f32 / inner.width() as f32];
    Screen::from_parts(inner, guard, tangents, depths, normals).unwrap()
}

#[test]
fn a_plane_is_open_and_no_more_hidden_than_its_virtual_points_stand_out() {
    for normal in [Vec3::NEG_Z, Vec3::new(0.3, 0.0, -1.0).normalize(), Vec3::new(0.2, -0.7, -1.0).normalize()]
    {
        let screen = planes(size(80, 45), 8, &[(normal, 4.0)]);
        for settings in variants() {
            let least = shade(&settings, &screen).values().iter().copied().fold(1.0, f32::min);
            // For a plane that falls away, the receiver angles meet above it (figure 5).
            let bound = if normal == Vec3::NEG_Z { 0.999 } else { 0.93 };
            assert!(least > bound, "{normal} {}: {least}", settings.label());
        }
    }
}

/// Computes the accessibility of an infinite floor, `s` radii away from an infinite wall, with linear falloff and
/// single rays.
fn corner(s: f64) -> f64 {
    let count = 400;
    let mut open = 0.0;
    for i in 0..count {
        for j in 0..count {
            let across = (f64::from(i) + 0.5) / f64::from(count);
            let turn = (f64::from(j) + 0.5) / f64::from(count) * std::f64::consts::TAU;
            let towards = across.sqrt() * libm::cos(turn);
            open += if towards > 0.0 { (s / towards).min(1.0) } else { 1.0 };
        }
    }
    open / f64::from(count * count)
}

#[test]
fn a_corner_darkens_as_rays_say() {
    // A floor and a wall meet in front of the eye at x = 0, each at 45 degrees to the view.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let (left, right) = (Vec3::new(half, 0.0, -half), Vec3::new(-half, 0.0, -half));
    let meet = 4.0;
    let screen = planes(size(160, 90), 40, &[(left, meet * half), (right, meet * half)]);
    for midway in [false, true] {
        let settings =
            FarFieldSettings { radius: 2.0, falloff: Falloff::Linear, midway, ..FarFieldSettings::default() };
        let found = shade(&settings, &screen);
        let mut last = 0.0;
        for x in 81..150 {
            let position = screen.position(x + 40, 45 + 40).unwrap();
            // Distance from the edge along the plane.
            let s = f64::from(position.x) / f64::from(half) / 2.0;
            let value = found.values()[45 * 160 + x as usize];
            if s < 1.0 {
                let bound = if midway { 0.02 } else { 0.05 };
                assert!((f64::from(value) - corner(s)).abs() < bound, "{midway} {s}: {value} {}", corner(s));
            } else {
                assert!(value > 0.99, "{s}: {value}");
            }
            assert!(value > last - 0.01, "darker further away: {s}");
            last = value;
        }
    }
}

#[test]
fn it_comes_close_to_rays_on_the_same_depth_field() {
    // For each scene the bounds of the paper's e_A and e_<5%, for slabs at their points and midway.
    for (name, bounds) in
        [("colonnade", [(2.1, 94.0), (1.2, 97.0)]), ("robot-lab", [(2.5, 94.0), (1.6, 95.0)])]
    {
        let screen = built_in(name, 1.0, size(160, 90), 16);
        let FarFieldSettings { radius, falloff, .. } = settings();
        let rays = by_rays(&screen, &ScreenRays { rays: 128, ..ScreenRays::far(radius, falloff) });
        for (midway, (average, right)) in [false, true].into_iter().zip(bounds) {
            let found = errors(&screen, &rays, &shade(&FarFieldSettings { midway, ..settings() }, &screen));
            assert!(found.0 < average && found.1 > right, "{name} {midway}: {found:?}");
        }
        let separate =
            FarFieldSettings { sectors: 18, separate: Some(Separation { blur: true }), ..settings() };
        let found = errors(&screen, &rays, &shade(&separate, &screen));
        assert!(found.0 < bounds[0].0 + 0.4, "{name} separate: {found:?}");
    }
}

#[test]
fn intervals_find_what_all_samples_find() {
    // The reference has no intervals and takes every sample of every line by itself. A shortest interval larger than
    // the screen leaves everything to the near field.
    for name in ["colonnade", "robot-lab"] {
        let screen = built_in(name, 0.5, size(96, 54), 8);
        let fast = FarFieldSettings { midway: true, ..settings() };
        let twin = FarFieldSettings { sectors: 32, interval: FarFieldSettings::MAX_INTERVAL, ..fast.clone() };
        let found = errors(&screen, &shade(&twin, &screen), &shade(&fast, &screen));
        assert!(found.0 < 1.2 && found.1 > 96.0, "{name}: {found:?}");
    }
}

#[test]
fn averages_and_maxima_are_those_of_single_samples() {
    let screen = built_in("colonnade", 0.0, size(61, 37), 4);
    let field = DepthField::new(&screen, None);
    for turn in [0.0_f32, 0.4, std::f32::consts::FRAC_PI_2, 2.2] {
        let along = Vec2::new(libm::cosf(turn), libm::sinf(turn));
        let mut scan = Scan::new(&field, ScanLines::new(field.pixels(), along, 5));
        scan.sum();
        let lines = scan.lines();
        let slope = field.pixels().slope();
        // The two maxima of one interval of one line, by brute force.
        let slow = |level: usize, row: usize, line: u32, sense: Sense| {
            let steps = lines.interval(level);
            let samples = (0..steps).filter_map(|step| {
                let at = lines.sample(row as u32 * steps + step, line);
                let inverse = field.inverse(along * at.x + along.perp() * at.y);
                (inverse > 0.0).then(|| (1.0 / inverse, sense.sign() * at.x * slope / inverse))
            });
            samples.fold(None, |best: Option<(f32, f32)>, (depth, out)| {
                let (peak, down) = best.unwrap_or((f32::NEG_INFINITY, f32::NEG_INFINITY));
                Some((peak.max(-depth), down.max(out - depth)))
            })
        };
        for (level, rows) in lines.levels().iter().enumerate() {
            for (row, extent) in rows.iter().enumerate().filter(|(_, extent)| extent.len > 0) {
                let (from, to) = (extent.first, extent.first + extent.len);
                for sense in Sense::BOTH {
                    let all: Vec<_> = (from..to).map(|line| slow(level, row, line, sense)).collect();
                    for (line, want) in (from..to).zip(&all) {
                        let point = scan.nearest(level, row, line as f32, sense);
                        let want = want.map(|(peak, down)| Vec2::new(down - peak, -peak));
                        assert_eq!(point.is_some(), want.is_some(), "{turn} {level} {row} {line}");
                        let apart = point.zip(want).map_or(0.0, |(a, b)| (a - b).length() / b.y);
                        assert!(apart < 1e-5, "{turn} {level} {row} {line}: {point:?} {want:?}");
                    }
                    // The range is a third of the lines in the middle and cuts the outermost ones in half.
                    let (a, b) = (from as f32 + extent.len as f32 / 3.0, to as f32 - 0.75);
                    if b <= a {
                        continue;
                    }
                    let mut sum = [0.0_f64; 3];
                    for (line, want) in (from..to).zip(&all) {
                        let part = (line as f32 + 0.5).min(b) - (line as f32 - 0.5).max(a);
                        if let Some((peak, down)) = want.filter(|_| part > 0.0) {
                            for (sum, value) in sum.iter_mut().zip([peak, down, 1.0]) {
                                *sum += f64::from(part * value);
                            }
                        }
                    }
                    let found = scan.average(level, row, a, b, sense);
                    match found {
                        None => assert!(sum[2] < 0.01, "{sum:?}"),
                        Some((point, share)) => {
                            let [peak, down] = [sum[0], sum[1]].map(|s| s / sum[2]);
                            assert!((f64::from(point.y) + peak).abs() < 1e-3 * peak.abs(), "{point} {peak}");
                            assert!((f64::from(point.x) - (down - peak)).abs() < 2e-3 * peak.abs());
                            assert!((f64::from(share) - sum[2] / f64::from(b - a)).abs() < 1e-3);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn on_any_number_of_threads_it_is_the_same() {
    let screen = built_in("robot-lab", 0.0, size(64, 36), 6);
    for settings in variants() {
        let [one, four] = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| shade(&settings, &screen))
        });
        assert_eq!(one, four, "{}", settings.label());
    }
}

#[test]
fn small_screens_sky_and_wide_guards_are_fine() {
    for settings in variants() {
        for (inner, guard) in
            [(size(1, 1), 0), (size(1, 1), 30), (size(2, 7), 1), (size(200, 1), 0), (size(1, 90), 3)]
        {
            let screen = planes(inner, guard, &[(Vec3::NEG_Z, 2.0)]);
            let found = shade(&settings, &screen);
            assert!(found.values().iter().all(|v| *v > 0.999), "{inner} {guard}: {}", settings.label());
        }
        let pixels = 12 * 9;
        let sky = Screen::from_parts(
            size(12, 9),
            0,
            [1.0; 2],
            vec![f32::INFINITY; pixels],
            vec![Vec3::ZERO; pixels],
        );
        assert!(shade(&settings, &sky.unwrap()).values().iter().all(|v| *v == 1.0));
        // A near surface in front of sky, with sky in the middle of it.
        let mut depths = vec![f32::INFINITY; pixels];
        for pixel in [40, 41, 42, 53, 54, 66] {
            depths[pixel] = 1e-3 * pixel as f32;
        }
        let screen = Screen::from_parts(size(12, 9), 0, [1.0; 2], depths, vec![Vec3::NEG_Z; pixels]).unwrap();
        assert!(shade(&settings, &screen).values().iter().all(|v| (0.0..=1.0).contains(v)));
    }
}

#[test]
fn the_times_are_those_of_the_papers_tables_and_memory_is_told() {
    let screen = built_in("colonnade", 0.0, size(48, 27), 4);
    let stages = |settings: FarFieldSettings| {
        let shaded = FarField::new(settings).unwrap().shade(&screen, &NoClock).unwrap();
        (shaded.stages.iter().map(|(name, _)| *name).collect::<Vec<_>>(), shaded.bytes)
    };
    let (names, bytes) = stages(settings());
    assert_eq!(names, ["scan", "prefix sum", "near field", "obscurance", "gather"]);
    let (far_alone, without_near) = stages(FarFieldSettings { near: None, ..settings() });
    assert_eq!(far_alone, ["scan", "prefix sum", "obscurance", "gather"]);
    assert_eq!(bytes - without_near, 48 * 27 * 4 * size_of::<Vec2>(), "horizons of four segments");
    let separate = FarFieldSettings { sectors: 18, separate: Some(Separation { blur: true }), ..settings() };
    let want = ["scan", "box average", "prefix sum", "near field", "obscurance", "gather", "blur"];
    assert_eq!(stages(separate).0, want);
    let (thick, _) = stages(FarFieldSettings { thickness: Some(0.1), ..settings() });
    assert_eq!(thick, ["scan", "near field", "obscurance", "gather"], "nothing may be averaged");
}

#[test]
fn what_is_out_of_range_is_refused() {
    let refused = |settings: FarFieldSettings| FarField::new(settings).unwrap_err().to_string();
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(refused(FarFieldSettings { radius, ..settings() }).contains("radius"));
    }
    let no_decay = Falloff::Exponential { decay: 0.0 };
    assert!(refused(FarFieldSettings { falloff: no_decay, ..settings() }).contains("decay"));
    for sectors in [0, 2, 7, 182] {
        assert!(refused(FarFieldSettings { sectors, ..settings() }).contains("number of sectors"));
    }
    for density in [0, 65] {
        assert!(refused(FarFieldSettings { density, ..settings() }).contains("density"));
    }
    for segments in [0, 9] {
        assert!(refused(FarFieldSettings { segments, ..settings() }).contains("segments"));
    }
    for interval in [0, 1, 257, u32::MAX] {
        assert!(refused(FarFieldSettings { interval, ..settings() }).contains("interval"));
    }
    for growth in [0.0, 0.99, f32::NAN] {
        let near = Some(NearField { growth });
        assert!(refused(FarFieldSettings { near, ..settings() }).contains("growth"));
    }
    for thickness in [0.0, f32::NAN] {
        assert!(refused(FarFieldSettings { thickness: Some(thickness), ..settings() }).contains("thickness"));
    }
    let separate = Some(Separation { blur: false });
    assert!(refused(FarFieldSettings { separate, ..settings() }).contains("by 18"));
    let tall = Screen::from_parts(size(4, 4), 0, [1.0, 400.0], vec![1.0; 16], vec![Vec3::NEG_Z; 16]).unwrap();
    let found = FarField::new(settings()).unwrap().shade(&tall, &NoClock);
    assert!(matches!(found, Err(ScreenError::Setting { method: "far-field", .. })), "{found:?}");
}

/// Computes the limit of the method with rays through the continuous depth field (section 8).
fn by_rays(screen: &Screen, rays: &ScreenRays) -> AoImage {
    rays.shade(screen, &NoClock).unwrap().image
}

/// Computes the estimator alone from samples `step` square pixels apart in `count` directions.
fn direct(screen: &Screen, radius: f32, falloff: &Falloff, count: u32, step: f32, joined: bool) -> AoImage {
    let field = DepthField::new(screen, None);
    let table = ObscuranceTable::new(radius, falloff);
    let estimator = Estimator { table: &table, thickness: None };
    let slope = field.pixels().slope();
    let values = screen.each_inner(|pixel| {
        let receiver = Receiver::new(pixel.position, pixel.normal);
        let at = field.pixels().place(pixel.x, pixel.y);
        let of_slice = |k: u32| {
            let turn = std::f32::consts::TAU * (k as f32 + 0.5) / count as f32;
            let along = Vec2::new(libm::cosf(turn), libm::sinf(turn));
            let slice = Slice::new(&receiver, along);
            let [across, depth] = slice.axes();
            let start = receiver.slope().dot(along);
            let end = (2.0 * field.pixels().half().length()).min(slice.reach(radius) / slope);
            let (mut horizon, mut hidden) = (slice.open(), 0.0);
            let mut before = Some((across * start + depth) * receiver.depth());
            for sample in 1..(end / step).ceil() as u32 {
                let distance = sample as f32 * step;
                let inverse = field.inverse(at + along * distance);
                let top = (inverse > 0.0).then(|| (across * (start + distance * slope) + depth) / inverse);
                if let Some(top) = top {
                    let stand = before.filter(|_| joined).map_or(SlabPlacement::Top, SlabPlacement::Joined);
                    hidden += estimator.add(&slice, &mut horizon, top, stand, 1.0);
                }
                before = top;
            }
            slice.weight() * hidden
        };
        1.0 - (0..count).map(of_slice).sum::<f32>() * std::f32::consts::TAU / count as f32
    });
    screen.image(values).unwrap()
}

#[test]
fn the_estimator_converges_to_rays() {
    for (name, falloff) in [
        ("colonnade", Falloff::Exponential { decay: 3.0 }),
        ("robot-lab", Falloff::Exponential { decay: 8.0 }),
        ("robot-lab", Falloff::Linear),
    ] {
        let screen = built_in(name, 1.0, size(48, 27), 5);
        let radius = settings().radius;
        let fine = ScreenRays { rays: 512, step_px: 0.1, ..ScreenRays::far(radius, falloff.clone()) };
        let rays = by_rays(&screen, &fine);
        let error =
            |step, joined| errors(&screen, &rays, &direct(&screen, radius, &falloff, 48, step, joined)).0;
        let slabs = [1.0, 0.5, 0.25, 0.1].map(|step| error(step, false));
        assert!(slabs.is_sorted_by(|a, b| *b < 0.8 * *a), "{name}: {slabs:?}");
        let joined = error(0.25, true);
        assert!(slabs[3] < 0.2 * slabs[0] && joined < 1.0, "{name}: {slabs:?}, joined {joined}");
    }
}

#[test]
fn slabs_closer_together_leave_less_error() {
    for name in ["colonnade", "robot-lab"] {
        let screen = built_in(name, 1.0, size(96, 54), 9);
        let FarFieldSettings { radius, falloff, .. } = settings();
        let truth = direct(&screen, radius, &falloff, 32, 0.25, true);
        let found = [1, 4, 16].map(|density| {
            let found = shade(&FarFieldSettings { interval: 2, density, ..settings() }, &screen);
            errors(&screen, &truth, &found).0
        });
        assert!(found.is_sorted_by(|a, b| *b < 0.7 * *a) && found[2] < 1.0, "{name}: {found:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_depth_field_gives_values_in_range(
        width in 1_u32..24,
        height in 1_u32..24,
        guard in 0_u32..5,
        slope in 0.01_f32..0.3,
        stretch in 0.1_f32..10.0,
        seed in any::<u64>(),
        variant in 0_usize..5,
    ) {
        let pixels = ((width + 2 * guard) * (height + 2 * guard)) as usize;
        let number = |pixel: usize, salt: u64| (crate::reference::mix(seed ^ salt ^ (pixel as u64) << 8) >> 40) as f32 / 16_777_216.0;
        let depths = (0..pixels).map(|p| if number(p, 1) < 0.1 { f32::INFINITY } else { 0.01 + 5.0 * number(p, 2) }).collect();
        let normals = (0..pixels)
            .map(|p| (Vec3::new(number(p, 3), number(p, 4), number(p, 5)) - 0.5).try_normalize().unwrap_or(Vec3::NEG_Z))
            .collect();
        let tangents = [slope * width as f32, slope * stretch * height as f32];
        let screen = Screen::from_parts(size(width, height), guard, tangents, depths, normals).unwrap();
        let settings = variants().swap_remove(variant);
        let found = shade(&settings, &screen);
        prop_assert_eq!(found.size(), size(width, height));
    }
}
