//! Priority of a point under a byte budget: its projected area in the camera that sees it largest.

use glam::Vec3;
use psao_proto::message::CameraPose;

use crate::visibility::View;

/// Weight of a point as large as its distance is long: a point of 4.4 cm (512 per square metre) has the largest weight up to 25 cm, 4,100
/// at 1 m, and 1 from 64 m on.
const WEIGHT_UNIT: f32 = (1 << 21) as f32;
/// What is left of the weight of points that no camera sees itself, although they are in the margin around its view.
const OUT_OF_VIEW_FACTOR: f32 = 1.0 / 8.0;

/// The cameras of a frame.
pub(super) struct ScreenArea {
    eyes: Vec<(Vec3, Option<View>)>,
}

impl ScreenArea {
    pub(super) fn new(cameras: &[CameraPose]) -> Self {
        Self { eyes: cameras.iter().map(|camera| (camera.eye.into(), View::new(camera, 1.0))).collect() }
    }

    /// Weight of a point of this Poisson-disk radius (metres) at a place of the world: the square of radius over distance
    /// for the camera to which it is largest, in steps of 2^-21, 1 to 65,535. Without cameras everything counts the same: 1.
    pub(super) fn weight(&self, place: Vec3, radius: f32) -> u16 {
        let seen = |(eye, view): &(Vec3, Option<View>)| {
            let share = if view.is_some_and(|view| view.sees(place)) { 1.0 } else { OUT_OF_VIEW_FACTOR };
            share * radius * radius / eye.distance_squared(place)
        };
        let largest = self.eyes.iter().map(seen).fold(0.0, f32::max);
        // The cast keeps within 0 to 65,535, infinity and what is not a number included.
        ((largest * WEIGHT_UNIT) as u16).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: [f32; 3]) -> CameraPose {
        let target = [eye[0], eye[1], eye[2] - 1.0];
        CameraPose { eye, target, up: [0.0, 1.0, 0.0], fov_y_deg: 60.0, aspect: 1.0 }
    }

    #[test]
    fn points_count_as_the_square_of_their_size() {
        let near = ScreenArea::new(&[camera([0.0; 3])]);
        let ahead = |metres: f32| near.weight(Vec3::new(0.0, 0.0, -metres), 0.0625);
        assert_eq!([1.0, 2.0, 4.0, 16.0].map(ahead), [8192, 2048, 512, 32]);
        assert_eq!([0.0, 0.1, 1e9, f32::INFINITY, f32::NAN].map(ahead), [65_535, 65_535, 1, 1, 1]);
        assert_eq!(near.weight(Vec3::new(0.0, 0.0, -2.0), 0.125), 4 * 2048);
        // Behind the camera, and beside its view.
        assert_eq!(near.weight(Vec3::new(0.0, 0.0, 2.0), 0.0625), 2048 / 8);
        assert!(near.weight(Vec3::new(2.0, 0.0, -2.0), 0.0625) < 2048 / 8);
    }

    #[test]
    fn the_camera_that_sees_it_best_decides() {
        let near = ScreenArea::new(&[camera([0.0; 3]), camera([0.0, 0.0, 3.0])]);
        // One metre ahead of the first; just behind the first, and ahead of the second.
        assert_eq!(near.weight(Vec3::new(0.0, 0.0, -1.0), 0.0625), 8192);
        assert_eq!(near.weight(Vec3::new(0.0, 0.0, 1.0), 0.0625), 2048);
        assert_eq!(ScreenArea::new(&[]).weight(Vec3::ZERO, 0.0625), 1);
    }
}
