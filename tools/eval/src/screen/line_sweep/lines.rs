//! The lines of a sweep.

use glam::Vec2;

use crate::screen::Screen;

/// Parallel lines of pixels that cover each pixel of the grid once. A line has one pixel in each column, or in each
/// row.
#[derive(Debug)]
pub(super) struct SweepLines {
    /// Number of lines, and of pixels in a line, including those beyond the grid.
    pub(super) count: usize,
    pub(super) length: usize,
    /// Whether lines have one pixel in each row instead of each column.
    steep: bool,
    /// Shift to the side in columns, or rows, for each pixel along.
    lean: f32,
    /// Number of the first line: the row, or column, where it crosses column, or row, 0.
    first: i32,
    /// Unit direction of the lines in view space.
    pub(super) ahead: Vec2,
}

impl SweepLines {
    pub(super) fn new(screen: &Screen, angle: f32) -> Self {
        let direction = Vec2::new(libm::cosf(angle), libm::sinf(angle));
        let steep = direction.y.abs() > direction.x.abs();
        let along = if steep { direction.y } else { direction.x };
        let direction = direction * along.signum();
        let size = [screen.size().width() as i32, screen.size().height() as i32];
        let ([length, side], lean) = if steep {
            ([size[1], size[0]], direction.x / direction.y)
        } else {
            (size, direction.y / direction.x)
        };
        let ends = [0, shift(lean, length - 1)];
        let first = -ends[0].max(ends[1]);
        let count = side - ends[0].min(ends[1]) - first;
        let ahead = (direction * screen.slope()).normalize();
        Self { count: count as usize, length: length as usize, steep, lean, first, ahead }
    }

    /// Returns column and row of a pixel, which may lie beside the grid.
    #[inline]
    pub(super) fn pixel(&self, line: usize, along: usize) -> (i32, i32) {
        let side = line as i32 + self.first + shift(self.lean, along as i32);
        if self.steep { (side, along as i32) } else { (along as i32, side) }
    }

    /// Returns the index of a pixel of the grid among the pixels of all lines.
    #[inline]
    pub(super) fn place(&self, x: i32, y: i32) -> usize {
        let (along, side) = if self.steep { (y, x) } else { (x, y) };
        (side - shift(self.lean, along) - self.first) as usize * self.length + along as usize
    }
}

/// Returns the shift to the side in pixels after `along` pixels.
#[inline]
fn shift(lean: f32, along: i32) -> i32 {
    (lean * along as f32 + 0.5).floor() as i32
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use psao_reconstruct::Size;

    use super::*;

    #[test]
    fn lines_hold_every_pixel_once() {
        let size = Size::new(13, 9).unwrap();
        let screen = Screen::from_parts(size, 2, [1.0, 0.7], vec![2.0; 221], vec![Vec3::NEG_Z; 221]).unwrap();
        for turn in 0..24 {
            let lines = SweepLines::new(&screen, turn as f32 * 0.13);
            let mut seen = vec![0; 17 * 13];
            for (line, along) in (0..lines.count).flat_map(|l| (0..lines.length).map(move |a| (l, a))) {
                let (x, y) = lines.pixel(line, along);
                if (0..17).contains(&x) && (0..13).contains(&y) {
                    seen[(y * 17 + x) as usize] += 1;
                    assert_eq!(lines.place(x, y), line * lines.length + along);
                }
            }
            assert!(seen.iter().all(|&n| n == 1), "{turn}: {seen:?}");
        }
    }
}
