//! Line-sweep ambient obscurance: one pass over the depth buffer for each direction.

mod lines;
mod slice;

use glam::{Vec2, Vec3};
use psao_server::clock::Clock;
use rayon::prelude::*;

use self::lines::SweepLines;
use self::slice::{HalfPlane, LinePoint};
use super::{Falloff, Screen, ScreenError, ScreenMethod, Shading, StageTimer, check_radius, check_setting};

/// Line-Sweep Ambient Obscurance (Timonen 2013, Computer Graphics Forum 32(4)).
///
/// In each of K directions it sweeps the depth buffer once along parallel lines, whatever the radius. A line keeps a
/// stack of the points behind the sweep that may be the largest occluder of a later point. A direction is hidden by the
/// occluder with the largest product of falloff and integral from horizon to tangent plane. The search for it has a
/// constant cost on average.
///
/// A point leaves the stack when the point below it hides more of the current pixel. It also leaves when neither hides
/// anything and it lies behind, or on, the line between its neighbours. Runs of points on one line become one edge. The
/// inside of an edge is still searched, because with a falloff the largest occluder of a wall is rarely at its end.
/// Sometimes the stack misses a larger occluder.
///
/// There is only one occluder a direction. Parts above it, and nearer parts below its horizon, are left out (Timonen,
/// far-field obscurance, section 2). Long falloffs are therefore too bright. `colonnade` at 3 m and exponential falloff
/// 3 lacks obscurance against rays through the depth buffer. Nine tenths of that are due to the single largest
/// occluder, searched one by one, and only a tenth to the stack. Without falloff, the largest occluder is the whole
/// horizon within the radius. Most of the loss is then due to the stack, whose removed points would have been the
/// horizon of later pixels.
///
/// The sources of this implementation are the abstract of the method and its description in the far-field paper.
///
/// The integral is that of a slice through the eye (Timonen, far-field obscurance, Eq. 2), which is exact for one
/// occluder at one distance. There is no noise and no blur, so few directions show as bands, as published.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSweep {
    /// Radius in metres.
    pub radius: f32,
    /// Directions K, an even number from 2 to 256; each set of lines has two.
    pub directions: u32,
    /// Weight of an occluder by its distance over the radius.
    pub falloff: Falloff,
    /// Distance of receivers from the surface along their normal, over the radius, 0 to 1. It ignores facets of meshes.
    /// The ray tracer's is 1/60.
    pub bias: f32,
}

impl LineSweep {
    const NAME: &'static str = "line-sweep";

    /// Returns settings for a radius in metres: 16 directions, linear falloff, the ray tracer's bias.
    pub fn new(radius: f32) -> Self {
        Self { radius, directions: 16, falloff: Falloff::Linear, bias: 1.0 / 60.0 }
    }

    fn validate(&self) -> Result<(), ScreenError> {
        check_radius(self.radius)?;
        let even = (self.directions & !1) as f32;
        check_setting(
            Self::NAME,
            "directions (an even number)",
            self.directions as f32,
            2.0,
            even.min(256.0),
        )?;
        check_setting(Self::NAME, "bias", self.bias, 0.0, 1.0)?;
        self.falloff.validate()
    }

    /// Adds to the value of each pixel of `line` what the points before it hide. The pixels are in the order of the
    /// sweep, which goes along `ahead` in view space.
    fn sweep<'a>(
        &self,
        line: impl Iterator<Item = (&'a mut f32, Option<LinePoint>)>,
        ahead: Vec2,
        stack: &mut Vec<StackEntry>,
    ) {
        stack.clear();
        for (hidden, point) in line {
            let Some(point) = point else { continue };
            let slice = HalfPlane::new(&point, ahead, self.bias * self.radius);
            let mut entry = StackEntry::after(stack.last(), point);
            let mut top = self.top(&slice, stack);
            let mut most = top;
            while let [.., below, last] = stack[..] {
                let merged = entry.merged(&last, &below);
                let next = self.top(&slice, &stack[..stack.len() - 1]);
                let idle = top == 0.0 && next == 0.0;
                if !(next > top || idle && (merged.run > 0 || last.is_behind(&below, &entry))) {
                    break;
                }
                most = most.max(next);
                stack.pop();
                (entry, top) = (merged, next);
            }
            *hidden += most;
            stack.push(entry);
        }
    }

    /// Returns the largest contribution of the last entry of a stack and of the edge that leads to it.
    fn top(&self, slice: &HalfPlane, stack: &[StackEntry]) -> f32 {
        let Some(entry) = stack.last() else { return 0.0 };
        let end = entry.point.position - slice.position;
        let mut most = self.contribution(slice, end);
        if let [.., before, _] = stack
            && entry.run > 1
        {
            let whole = before.point.position - entry.point.position;
            let start = end + whole;
            // An edge with both ends below the tangent plane is below it everywhere.
            if end.dot(slice.normal).max(start.dot(slice.normal)) > 0.0 {
                // Samples from the nearest place of the edge to the furthest within the radius, denser near the former.
                let nearest = (-end.dot(whole) / whole.length_squared()).clamp(0.0, 1.0);
                let reach = (self.radius / whole.length()).min(1.0 - nearest);
                for part in [0.0, 0.03, 0.06, 0.12, 0.25, 0.5] {
                    most = most.max(self.contribution(slice, end + whole * (nearest + reach * part)));
                }
            }
        }
        most
    }

    /// Returns the falloff times the share of the slice that a horizon at `to` from the receiver hides.
    #[inline]
    fn contribution(&self, slice: &HalfPlane, to: Vec3) -> f32 {
        let distance = to.length();
        // Pixels lie a little beside the line, where the tangent plane is at another angle. Points that are not above
        // that plane do not count as above the line's tangent.
        if distance >= self.radius || to.dot(slice.normal) <= 0.0 {
            return 0.0;
        }
        self.falloff.weight(distance / self.radius) * slice.hidden(to)
    }
}

impl ScreenMethod for LineSweep {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn label(&self) -> String {
        format!("line sweep, {} directions", self.directions)
    }

    fn shade(&self, screen: &Screen, clock: &dyn Clock) -> Result<Shading, ScreenError> {
        self.validate()?;
        let mut stages = StageTimer::new(clock);
        let mut values = vec![1.0_f32; screen.inner().pixels()];
        let mut most = 0;
        let sets = self.directions / 2;
        for set in 0..sets {
            let lines = SweepLines::new(screen, std::f32::consts::PI * set as f32 / sets as f32);
            let mut hidden = vec![0.0_f32; lines.count * lines.length];
            hidden.par_chunks_mut(lines.length).enumerate().for_each_init(
                Vec::new,
                |stack, (line, hidden)| {
                    let point = |along| LinePoint::at(screen, lines.pixel(line, along), lines.ahead);
                    self.sweep(hidden.iter_mut().enumerate().map(|(i, v)| (v, point(i))), lines.ahead, stack);
                    // The same line from the other end.
                    let back = |along: usize| {
                        let point = point(along)?;
                        Some(LinePoint { along: -point.along, ..point })
                    };
                    self.sweep(
                        hidden.iter_mut().enumerate().rev().map(|(i, v)| (v, back(i))),
                        -lines.ahead,
                        stack,
                    );
                },
            );
            let (guard, width) = (screen.guard() as i32, screen.inner().width() as usize);
            values.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
                let y = row as i32 + guard;
                for (value, x) in values.iter_mut().zip(guard..) {
                    *value -= hidden[lines.place(x, y)] * (2.0 / self.directions as f32);
                }
            });
            most = most.max(hidden.len() * size_of::<f32>());
        }
        stages.end("sweep");
        stages.finish(screen, values, most)
    }
}

/// A point on the stack, and the edge to it from the one below.
#[derive(Clone, Copy, Debug)]
struct StackEntry {
    point: LinePoint,
    /// The direction in which the edge began.
    heading: Vec2,
    /// Number of pixels of the edge; 0 when the pixels between its ends do not lie on it.
    run: u32,
}

impl StackEntry {
    /// Largest sine of the angle between an edge's first direction and its points. Points of a plane are on the edge up
    /// to rounding.
    const STRAIGHT: f32 = 2e-3;

    /// Makes the entry of `point`, which follows the last entry of the stack.
    fn after(last: Option<&Self>, point: LinePoint) -> Self {
        let heading = last.map_or(Vec2::ZERO, |last| (point.flat() - last.point.flat()).normalize_or_zero());
        Self { point, heading, run: 1 }
    }

    /// Returns the entry with an edge from `below`, when `last` between the two is removed.
    fn merged(&self, last: &Self, below: &Self) -> Self {
        let whole = (self.point.flat() - below.point.flat()).normalize_or_zero();
        let straight =
            |heading: Vec2| heading.perp_dot(whole).abs() < Self::STRAIGHT && heading.dot(whole) > 0.0;
        let one = self.run > 0 && last.run > 0 && straight(last.heading) && straight(self.heading);
        Self { point: self.point, heading: last.heading, run: if one { self.run + last.run } else { 0 } }
    }

    /// Returns whether the straight line from `before` to `after` hides the point from the eye.
    #[inline]
    fn is_behind(&self, before: &Self, after: &Self) -> bool {
        let start = before.point.flat();
        (self.point.flat() - start).perp_dot(after.point.flat() - start) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;
    use psao_server::clock::NoClock;
    use psao_server::scene::Scene;
    use psao_server::world::SceneBvh;

    use super::*;
    use crate::adapter::SceneView;
    use crate::screen::ScreenRays;

    fn screen(width: u32, height: u32, guard: u32) -> Screen {
        let scene = std::sync::Arc::new(Scene::load("colonnade").unwrap());
        let world = SceneBvh::new(&scene, &scene.pose(1.0));
        let size = Size::new(width, height).unwrap();
        Screen::new(&SceneView::new(&world), &scene.camera(1.0), size, guard).unwrap()
    }

    /// Returns for each point the largest contribution of all points before it, searched one by one.
    fn naive(method: &LineSweep, line: &[Option<LinePoint>], ahead: Vec2) -> Vec<f32> {
        let most = |at: usize| {
            let slice = HalfPlane::new(line[at].as_ref()?, ahead, method.bias * method.radius);
            let before = line[..at].iter().flatten();
            Some(
                before
                    .map(|point| method.contribution(&slice, point.position - slice.position))
                    .fold(0.0, f32::max),
            )
        };
        (0..line.len()).map(|at| most(at).unwrap_or(0.0)).collect()
    }

    #[test]
    fn the_stack_hides_nearly_what_the_largest_of_all_occluders_does() {
        let screen = screen(96, 54, 8);
        let method = LineSweep::new(0.6);
        let (mut sum, mut lost, mut more, mut count) = (0.0, 0.0, 0.0, 0);
        for turn in 0..8 {
            let lines = SweepLines::new(&screen, turn as f32 * 0.39);
            for line in 0..lines.count {
                let points: Vec<Option<LinePoint>> = (0..lines.length)
                    .map(|i| LinePoint::at(&screen, lines.pixel(line, i), lines.ahead))
                    .collect();
                let mut found = vec![0.0; points.len()];
                method.sweep(found.iter_mut().zip(points.iter().copied()), lines.ahead, &mut Vec::new());
                for (found, truth) in found.iter().zip(naive(&method, &points, lines.ahead)) {
                    // A place between two pixels of an edge may hide more than either.
                    more += f64::from(found - truth).max(0.0);
                    sum += f64::from(truth);
                    lost += f64::from(truth - found).max(0.0);
                    count += 1;
                }
            }
        }
        assert!(sum / f64::from(count) > 0.01, "{sum} in {count}");
        assert!(lost < 0.09 * sum && more < 0.01 * sum, "{lost} lost and {more} more of {sum}");
    }

    #[test]
    fn pixels_of_one_row_hide_each_other_only_along_it() {
        let (size, depth) = (Size::new(9, 1).unwrap(), vec![4.0, 4.0, 4.0, 3.5, 3.5, 4.0, 4.0, 4.0, 4.0]);
        let screen = Screen::from_parts(size, 0, [1.0, 0.1], depth, vec![Vec3::NEG_Z; 9]).unwrap();
        let image = LineSweep::new(4.0).shade(&screen, &NoClock).unwrap().image;
        let open: Vec<bool> = image.values().iter().map(|&v| v == 1.0).collect();
        assert_eq!(open, [false, false, false, true, true, false, false, false, false], "{image:?}");
    }

    #[test]
    fn what_is_missing_against_rays_is_what_the_largest_occluder_leaves_out() {
        let screen = screen(64, 36, 6);
        let falloff = Falloff::Exponential { decay: 3.0 };
        let method = LineSweep { bias: 1e-4, falloff: falloff.clone(), ..LineSweep::new(3.0) };
        let mean = |image: &[f32]| image.iter().map(|v| f64::from(*v)).sum::<f64>() / image.len() as f64;
        let [found, rays] = [&method as &dyn ScreenMethod, &ScreenRays::far(3.0, falloff)]
            .map(|method| mean(method.shade(&screen, &NoClock).unwrap().image.values()));
        // The largest of all occluders of every direction, one by one.
        let sets = method.directions / 2;
        let mut hidden = 0.0;
        for set in 0..sets {
            let lines = SweepLines::new(&screen, std::f32::consts::PI * set as f32 / sets as f32);
            let mut of_pixels = vec![0.0; lines.count * lines.length];
            for (line, sums) in of_pixels.chunks_mut(lines.length).enumerate() {
                for ahead in [lines.ahead, -lines.ahead] {
                    let mut points: Vec<Option<LinePoint>> = (0..lines.length)
                        .map(|i| LinePoint::at(&screen, lines.pixel(line, i), ahead))
                        .collect();
                    if ahead != lines.ahead {
                        points.reverse();
                        sums.reverse();
                    }
                    for (sum, most) in sums.iter_mut().zip(naive(&method, &points, ahead)) {
                        *sum += most;
                    }
                }
                sums.reverse();
            }
            for (x, y) in (6..42).flat_map(|y| (6..70).map(move |x| (x, y))) {
                hidden += f64::from(of_pixels[lines.place(x, y)]);
            }
        }
        let largest = 1.0 - hidden / f64::from(sets * 64 * 36);
        let share = (largest - rays) / (found - rays);
        assert!(found - rays > 0.05 && share > 0.85 && share < 1.0, "{rays} {largest} {found}");
    }
}
