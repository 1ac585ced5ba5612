//! Reference pictures: the ambient occlusion of every pixel by many rays (paper, section 4.1, with 512 samples a
//! pixel).

use glam::{Mat3, Vec2, Vec3};
use psao_reconstruct::{AoImage, AoImageError, GBuffer, Surface};
use psao_server::ao::{AoError, AoSettings, Occlusion, Scratch, Tracer};
use psao_server::points::RayKey;
use rayon::prelude::*;

use crate::adapter::{RayScene, SceneView};

/// Number of rays a pixel in the paper's reference (section 4.1).
pub const PAPER_RAYS: u32 = 512;

/// Number of sets of directions. Each pixel chooses one and turns it by its own angle.
const DIRECTION_SETS: usize = 16;

/// Error of tracing a reference.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// A setting is out of its range.
    #[error(transparent)]
    Settings(#[from] AoError),
    /// A pixel's ambient occlusion is not in `[0, 1]`, because the scene returned an invalid distance.
    #[error("the scene returned a distance that is negative or not a number: {0}")]
    Values(#[from] AoImageError),
}

/// Traces the ambient occlusion of every fragment of `view` with `settings.rays` rays; background is 1.
///
/// `settings` gives radius, falloff and ray bias, which should equal those of the stream. Only the number of rays
/// differs; it is usually [`PAPER_RAYS`]. Directions are cosine-distributed around the shading normal and stratified
/// within a pixel. They depend on the seed and the pixel alone, not on the number of threads.
///
/// The rays of a pixel are traced together, as those of a point are. [`reference_by_single_rays`] is the slow
/// counterpart.
///
/// # Errors
///
/// [`ReferenceError::Settings`] when a setting is out of its range.
pub fn reference(
    scene: &SceneView<'_>,
    view: &GBuffer,
    settings: &AoSettings,
) -> Result<AoImage, ReferenceError> {
    let tracer = Tracer::new(*settings)?;
    each_fragment(view, Scratch::default, |scratch, pixel, fragment| {
        tracer.at(scene.world(), RayKey(pixel as u32), fragment.position, fragment.normal, scratch).ao
    })
}

/// Traces a reference as [`reference()`] does, one ray after the other, through any [`RayScene`].
///
/// It has its own directions and does not use the server's tracer. It is several times slower.
///
/// # Errors
///
/// [`ReferenceError::Settings`] when a setting is out of its range, [`ReferenceError::Values`] when the scene
/// returns an invalid distance.
pub fn reference_by_single_rays<R: RayScene + ?Sized>(
    scene: &R,
    view: &GBuffer,
    settings: &AoSettings,
) -> Result<AoImage, ReferenceError> {
    settings.validate()?;
    let sets: Vec<Vec<Vec3>> = (0..DIRECTION_SETS).map(|set| directions(settings, set)).collect();
    each_fragment(
        view,
        || (),
        |(), pixel, fragment| {
            let choice = mix(settings.seed ^ mix(pixel as u64));
            accessibility(
                scene,
                fragment,
                settings,
                &sets[choice as usize % DIRECTION_SETS],
                (choice >> 32) as u32,
            )
        },
    )
}

/// Returns an image of the values of `shade` at each fragment. Rows run on all threads; `memory` is called once a row.
fn each_fragment<M>(
    view: &GBuffer,
    memory: impl Fn() -> M + Sync,
    shade: impl Fn(&mut M, usize, &Surface) -> f32 + Sync,
) -> Result<AoImage, ReferenceError> {
    let width = view.size().width() as usize;
    let mut values = vec![1.0_f32; view.size().pixels()];
    values.par_chunks_mut(width).enumerate().for_each_init(&memory, |memory, (y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let pixel = y * width + x;
            if let Some(fragment) = view.fragment(pixel) {
                *value = shade(memory, pixel, &fragment);
            }
        }
    });
    Ok(AoImage::new(view.size(), values)?)
}

/// Returns the mean over the directions of `min(distance, R) / R`, or the share of directions without a hit within R.
fn accessibility<R: RayScene + ?Sized>(
    scene: &R,
    fragment: &Surface,
    settings: &AoSettings,
    directions: &[Vec3],
    turn: u32,
) -> f32 {
    let radius = settings.radius;
    let origin = fragment.position + fragment.normal * settings.bias();
    let to_world = tangent_frame(fragment.normal, turn);
    let sum: f64 = directions
        .iter()
        .map(|&local| {
            let direction = to_world * local;
            match settings.kind {
                Occlusion::Obscurance => scene
                    .distance(origin, direction, radius)
                    .map_or(1.0, |t| f64::from(t.min(radius)) / f64::from(radius)),
                Occlusion::Binary => f64::from(u8::from(!scene.occluded(origin, direction, radius))),
            }
        })
        .sum();
    // The mean of values in [0, 1] is in range, and rounding to f32 keeps it there.
    (sum / directions.len() as f64) as f32
}

/// Returns cosine-distributed directions around +Z: a Hammersley set, shifted by an amount that depends on `set`.
pub(crate) fn directions(settings: &AoSettings, set: usize) -> Vec<Vec3> {
    let shift = mix(settings.seed.wrapping_add(set as u64 + 1));
    let shift = [fraction(shift as u32), fraction((shift >> 32) as u32)];
    (0..settings.rays)
        .map(|ray| {
            let across = ((f64::from(ray) + 0.5) / f64::from(settings.rays) + shift[0]).fract();
            let turn = (fraction(ray.reverse_bits()) + shift[1]).fract() * std::f64::consts::TAU;
            let radius = across.sqrt();
            let local = [radius * libm::cos(turn), radius * libm::sin(turn), (1.0 - across).sqrt()];
            Vec3::from(local.map(|axis| axis as f32))
        })
        .collect()
}

/// Returns a frame whose z axis is `normal`, turned around it by `turn` / 2^32 of a full turn.
pub(crate) fn tangent_frame(normal: Vec3, turn: u32) -> Mat3 {
    let helper = if normal.x.abs() < 0.5 { Vec3::X } else { Vec3::Y };
    let side = normal.cross(helper).normalize();
    let other = normal.cross(side);
    let angle = (fraction(turn) * std::f64::consts::TAU) as f32;
    let Vec2 { x: cos, y: sin } = Vec2::new(libm::cosf(angle), libm::sinf(angle));
    Mat3::from_cols(side * cos + other * sin, other * cos - side * sin, normal)
}

/// Returns `bits` / 2^32, in `[0, 1)`.
pub(crate) fn fraction(bits: u32) -> f64 {
    f64::from(bits) / 4_294_967_296.0
}

/// Hashes a value by the increment and the finaliser of `SplitMix64` (Steele et al. 2014).
pub(crate) fn mix(value: u64) -> u64 {
    let mut h = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ (h >> 31)
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;

    use super::*;

    /// A floor at y = 0 and a ball over it.
    struct Ball {
        centre: Vec3,
        radius: f32,
    }

    impl RayScene for Ball {
        fn distance(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<f32> {
            let floor = -origin.y / direction.y;
            let to = self.centre - origin;
            let along = to.dot(direction);
            let inside = along * along - to.length_squared() + self.radius * self.radius;
            let ball = if inside < 0.0 { f32::NAN } else { along - inside.sqrt() };
            [floor, ball].into_iter().filter(|&t| t > 0.0 && t < tmax).min_by(f32::total_cmp)
        }
    }

    fn floor_view(size: Size) -> GBuffer {
        let fragment = Surface { t: 1.0, position: Vec3::ZERO, normal: Vec3::Y, instance: 0, rest: None };
        GBuffer::from_fragments(size, vec![Some(fragment); size.pixels()]).unwrap()
    }

    fn settings(rays: u32, kind: Occlusion) -> AoSettings {
        AoSettings::default().with_rays(rays).with_radius(60.0).with_kind(kind).with_seed(7)
    }

    /// Returns a ball over the floor. The ray bias is 1 m at a radius of 60 m. A ball of radius `r` with its centre at
    /// 1 + `h` hides (r / h)^2 of the cosine-weighted hemisphere.
    fn ball() -> Ball {
        Ball { centre: Vec3::new(0.0, 6.0, 0.0), radius: 3.0 }
    }

    #[test]
    fn a_ball_hides_its_form_factor() {
        let view = floor_view(Size::new(32, 32).unwrap());
        let image =
            reference_by_single_rays(&ball(), &view, &settings(PAPER_RAYS, Occlusion::Binary)).unwrap();
        let truth = 1.0 - 0.36;
        let mean = image.values().iter().sum::<f32>() / 1024.0;
        assert!((mean - truth).abs() < 5e-4, "{mean}");
        let worst = image.values().iter().map(|v| (v - truth).abs()).fold(0.0, f32::max);
        assert!(worst < 0.02, "{worst}");
    }

    #[test]
    fn obscurance_counts_how_near_the_ball_is() {
        let view = floor_view(Size::new(32, 32).unwrap());
        let image = reference_by_single_rays(&ball(), &view, &settings(256, Occlusion::Obscurance)).unwrap();
        // The integral over the ball's cap by brute force, with cosine weights and distance over R.
        let steps = 20_000;
        let mut truth = 0.0;
        for step in 0..steps {
            let across = (f64::from(step) + 0.5) / f64::from(steps);
            let up = (1.0 - across).sqrt();
            let inside = 25.0 * up * up - 25.0 + 9.0;
            truth += if inside < 0.0 { 1.0 } else { (5.0 * up - inside.sqrt()) / 60.0 } / f64::from(steps);
        }
        let mean = image.values().iter().map(|&v| f64::from(v)).sum::<f64>() / 1024.0;
        assert!((mean - truth).abs() < 1e-3, "{mean} {truth}");
    }

    #[test]
    fn an_open_floor_and_the_background_are_exactly_open() {
        let nothing = Ball { centre: Vec3::new(0.0, 1e6, 0.0), radius: 1.0 };
        let size = Size::new(3, 1).unwrap();
        let floor = Surface { t: 1.0, position: Vec3::ZERO, normal: Vec3::Y, instance: 0, rest: None };
        let view = GBuffer::from_fragments(size, vec![Some(floor), None, Some(floor)]).unwrap();
        for kind in [Occlusion::Binary, Occlusion::Obscurance] {
            assert_eq!(
                reference_by_single_rays(&nothing, &view, &settings(100, kind)).unwrap().values(),
                [1.0; 3]
            );
        }
    }

    #[test]
    fn neighbouring_pixels_have_directions_of_their_own_whatever_the_threads() {
        let view = floor_view(Size::new(16, 16).unwrap());
        let ball = Ball { centre: Vec3::new(2.0, 4.0, 1.0), radius: 2.5 };
        let draw = || reference_by_single_rays(&ball, &view, &settings(16, Occlusion::Binary)).unwrap();
        let image = draw();
        let different = image.values().windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(different > 100, "{different}");
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool(1).install(draw), image);
        assert_eq!(pool(3).install(draw), image);
        let other = settings(16, Occlusion::Binary).with_seed(8);
        assert_ne!(reference_by_single_rays(&ball, &view, &other).unwrap(), image);
    }

    #[test]
    fn settings_out_of_range_are_errors() {
        let view = floor_view(Size::new(1, 1).unwrap());
        let none = settings(0, Occlusion::Binary);
        assert!(matches!(reference_by_single_rays(&ball(), &view, &none), Err(ReferenceError::Settings(_))));
    }

    #[test]
    fn frames_are_orthonormal_for_every_normal() {
        for index in 0..1_000 {
            let normal = Vec3::new(
                fraction(mix(index) as u32) as f32 - 0.5,
                fraction((mix(index) >> 32) as u32) as f32 - 0.5,
                fraction(mix(index + 5_000) as u32) as f32 - 0.5,
            );
            let normal = normal.try_normalize().unwrap_or(Vec3::X);
            let m = tangent_frame(normal, (mix(index) >> 16) as u32);
            assert!((m.transpose() * m - Mat3::IDENTITY).to_cols_array().iter().all(|e| e.abs() < 1e-5));
            assert!((m.determinant() - 1.0).abs() < 1e-5);
            assert_eq!(m.z_axis, normal);
        }
    }
}
