//! The pictures of a clip and their references.

use std::sync::Arc;

use psao_proto::message::CameraPose;
use psao_reconstruct::{AoImage, GBuffer, Size, cast_view};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;

use super::SweepError;
use crate::adapter::SceneView;
use crate::reference::reference;
use crate::screen::{Screen, ScreenError, ScreenMethod, ScreenRays};

/// The rays of the references that pictures are compared with.
#[derive(Clone, Debug, PartialEq)]
pub enum ReferenceRays {
    /// Rays through the scene. They meet hidden surfaces and those off the screen.
    Scene(AoSettings),
    /// Rays through the depth buffer: the best possible result from what the screen shows (Timonen 2013, section 8).
    Screen(ScreenRays),
}

/// A view, and its AO by many rays.
pub struct View {
    /// Time in the clip, in seconds.
    pub time_s: f64,
    /// The camera.
    pub camera: CameraPose,
    /// Input of reconstruction.
    pub buffer: GBuffer,
    /// Input of screen-space methods.
    pub screen: Screen,
    /// The reference AO.
    pub truth: AoImage,
}

/// Casts views of `scene` with its own camera at each of the times, and traces the references.
///
/// The screens have a guard band of `guard` pixels. Geometry is that of the picture's time, even where a stream is
/// behind. `done` is called after each picture.
///
/// # Errors
///
/// [`SweepError`] when a camera is degenerate, a setting of the rays is out of range, or the screen with its guard band
/// is too large.
pub fn views(
    scene: &Arc<Scene>,
    times_s: &[f64],
    size: Size,
    guard: u32,
    truth: &ReferenceRays,
    done: &dyn Fn(),
) -> Result<Vec<View>, SweepError> {
    let look = |&time_s: &f64| {
        let camera = CameraPose { aspect: size.aspect(), ..scene.camera(time_s) };
        let world = SceneBvh::new(scene, &scene.pose(time_s));
        let seen = SceneView::new(&world);
        let buffer = cast_view(&seen, &camera, size)?;
        let screen = Screen::new(&seen, &camera, size, guard)?;
        let truth = match truth {
            ReferenceRays::Scene(ao) => reference(&seen, &buffer, ao)?,
            ReferenceRays::Screen(rays) => rays.shade(&screen, &NoClock)?.image,
        };
        done();
        Ok(View { time_s, camera, buffer, screen, truth })
    };
    times_s.iter().map(look).collect()
}

/// Returns the horizontal length in pixels of `radius_m` metres, perpendicular to the view, at the median depth of a
/// clip's pictures.
///
/// It samples every fourth pixel each way, and returns 0 when the pictures show no surface.
///
/// # Errors
///
/// [`SweepError`] when a camera is degenerate.
pub fn reach_px(scene: &Arc<Scene>, times_s: &[f64], size: Size, radius_m: f32) -> Result<f32, SweepError> {
    let coarse = Size::new(size.width().div_ceil(4), size.height().div_ceil(4)).map_err(ScreenError::from)?;
    let larger = size.width() as f32 / coarse.width() as f32;
    let mut found: Vec<f32> = Vec::new();
    for &time_s in times_s {
        let camera = CameraPose { aspect: size.aspect(), ..scene.camera(time_s) };
        let world = SceneBvh::new(scene, &scene.pose(time_s));
        let screen = Screen::new(&SceneView::new(&world), &camera, coarse, 0)?;
        let reach = |&depth: &f32| screen.radius_px(radius_m, depth).x * larger;
        found.extend(screen.depths().iter().map(reach).filter(|&pixels| pixels > 0.0));
    }
    found.sort_by(f32::total_cmp);
    Ok(found.get(found.len() / 2).copied().unwrap_or(0.0))
}

/// Returns ascending times of `count` pictures of a clip of `seconds` that is shown at `rate` frames a second.
///
/// The clip is cut into `count` equal parts, and multiples of the golden ratio place a picture in each part. So
/// pictures show a stream with fewer frames a second at every age of its frames. The first frame, in which everything
/// is new, is left out where there are others. A clip of fewer frames has fewer pictures.
#[must_use]
pub fn picture_times(seconds: f64, rate: f64, count: u32) -> Vec<f64> {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let last = (seconds * rate + 1e-6).floor().max(1.0) as u64 - 1;
    let mut frames: Vec<u64> = (1..=count)
        .map(|picture| {
            let within = (f64::from(picture) * GOLDEN).fract();
            let at = (f64::from(picture - 1) + within) / f64::from(count) * seconds;
            ((at * rate) as u64).clamp(last.min(1), last)
        })
        .collect();
    frames.dedup();
    frames.into_iter().map(|frame| frame as f64 / rate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_lie_on_frames_in_the_clip_and_ascend() {
        for (seconds, count) in [(2.0, 4), (1.0, 60), (0.5, 100), (2.0 / 60.0, 3), (1.0 / 60.0, 1)] {
            let times = picture_times(seconds, 60.0, count);
            assert!(!times.is_empty() && times.len() <= count as usize);
            assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
            for time in times {
                let frame = time * 60.0;
                assert!((frame - frame.round()).abs() < 1e-9 && time < seconds, "{time} of {seconds}");
            }
        }
    }

    #[test]
    fn the_reach_is_that_of_the_median_pixel_and_grows_as_the_radius() {
        let size = Size::new(64, 36).unwrap();
        let scene = Arc::new(Scene::load("colonnade").unwrap());
        let reach = |radius| reach_px(&scene, &[0.0, 0.5], size, radius).unwrap();
        let rays = AoSettings::default().with_rays(1);
        let views = views(&scene, &[0.0, 0.5], size, 0, &ReferenceRays::Scene(rays), &|| ()).unwrap();
        let screens = views.iter().map(|view| &view.screen);
        let all =
            screens.flat_map(|screen| screen.depths().iter().map(|&depth| screen.radius_px(1.0, depth).x));
        let all: Vec<f32> = all.filter(|&pixels| pixels > 0.0).collect();
        let median = reach(1.0);
        let shorter = all.iter().filter(|&&pixels| pixels < median).count() as f64 / all.len() as f64;
        assert!((shorter - 0.5).abs() < 0.03, "{shorter}");
        assert!((reach(2.0) / median - 2.0).abs() < 1e-4);
        let away = Arc::new(Scene::from_triangles("speck", &[crate::shapes::floor(1e-6)], 0.6).unwrap());
        let nothing = reach_px(&away, &[], size, 1.0).unwrap();
        assert_eq!(nothing, 0.0, "no picture, no surface");
    }

    #[test]
    fn a_slow_stream_is_seen_at_every_age() {
        let mut ages = [0; 4];
        for time in picture_times(4.0, 60.0, 16) {
            ages[(time * 60.0).round() as usize % 4] += 1;
        }
        assert!(ages.iter().all(|&count| count >= 2), "{ages:?}");
    }
}
