//! A controller of frame time: how many rays the next frame may take, from the times of earlier frames.

use super::FrameStats;

/// Weight of the newest frame in the running means.
const LEARNING_RATE: f64 = 0.2;
/// Share of the frame time that is planned for. The rest covers variation from frame to frame.
const PLANNED_SHARE: f64 = 0.85;

/// Turns a time per frame into a number of rays per frame.
#[derive(Clone, Debug)]
pub struct FrameTimeController {
    /// Microseconds a frame may take.
    frame: f64,
    /// Microseconds a ray takes; nothing before any was traced.
    ray: Option<f64>,
    /// Microseconds of everything else.
    rest: f64,
}

impl FrameTimeController {
    /// Frames may take `micros` each.
    #[must_use]
    pub fn new(micros: u64) -> Self {
        Self { frame: micros as f64, ray: None, rest: 0.0 }
    }

    /// Takes in what a frame took. The first, which makes the points' AO, tells how long a ray takes, not how long the rest.
    pub fn learn(&mut self, frame: &FrameStats) {
        let mix = |known: f64, new: f64| known + (new - known) * LEARNING_RATE;
        let times = &frame.micros;
        if frame.rays > 0 {
            let ray = times.trace as f64 / frame.rays as f64;
            self.ray = Some(self.ray.map_or(ray, |known| mix(known, ray)));
        }
        if !frame.first {
            let rest = (times.pose + times.bvh + times.place + times.decide + times.encode) as f64;
            self.rest = mix(self.rest, rest);
        }
    }

    /// Rays that the next frame has time for; nothing before it is known how long one takes. At least one, so that
    /// tracing never stops however much the rest takes.
    #[must_use]
    pub fn rays(&self) -> Option<u64> {
        let left = (self.frame - self.rest).max(0.0) * PLANNED_SHARE;
        // The cast saturates.
        self.ray.map(|ray| ((left / ray) as u64).max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::super::StageMicros;
    use super::*;

    fn frame(rays: u64, trace: u64, rest: u64, first: bool) -> FrameStats {
        let micros = StageMicros { trace, encode: rest, ..StageMicros::default() };
        FrameStats { rays, micros, first, ..FrameStats::default() }
    }

    #[test]
    fn rays_fill_what_is_left_of_the_time() {
        let mut pacing = FrameTimeController::new(16_667);
        assert_eq!(pacing.rays(), None);
        pacing.learn(&frame(1_000_000, 50_000, 900_000, true));
        assert_eq!(pacing.rays(), Some((16_667.0 * PLANNED_SHARE / 0.05) as u64));
        for _ in 0..100 {
            pacing.learn(&frame(100_000, 10_000, 6_667, false));
        }
        let rays = pacing.rays().unwrap();
        assert!(rays.abs_diff((10_000.0 * PLANNED_SHARE / 0.1) as u64) < 10, "{rays}");
        // A frame without traced points does not show how long a ray takes.
        pacing.learn(&frame(0, 3, 6_667, false));
        assert_eq!(pacing.rays(), Some(rays));
    }

    #[test]
    fn there_are_always_some() {
        let mut pacing = FrameTimeController::new(1_000);
        for _ in 0..100 {
            pacing.learn(&frame(10, 1_000_000, 5_000, false));
        }
        assert_eq!(pacing.rays(), Some(1));
        let mut pacing = FrameTimeController::new(u64::MAX);
        pacing.learn(&frame(10, 0, 0, false));
        assert_eq!(pacing.rays(), Some(u64::MAX));
    }
}
