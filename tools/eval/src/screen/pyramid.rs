//! A pyramid of smaller and smaller copies of the depth field.

use glam::Vec2;
use rayon::prelude::*;

use super::Screen;

/// Reduction of the covered pixels to a pixel of the next level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reduce {
    /// Their mean; sky when one of them is sky, which is the limit for a far plane at infinity.
    Mean,
    /// One of them, alternating along rows and columns: the rotated grid of `McGuire` et al. (2012), for a factor of 2.
    /// Every depth is one of the screen's.
    Pick,
}

/// Levels of depth above level 0, which is the screen itself.
#[derive(Debug)]
pub(crate) struct DepthPyramid {
    levels: Vec<PyramidLevel>,
}

#[derive(Debug)]
struct PyramidLevel {
    width: usize,
    height: usize,
    /// Pixels of the screen per pixel of this level.
    scale: i32,
    depth: Vec<f32>,
}

impl DepthPyramid {
    /// Makes `levels` levels above the screen's own, each smaller by `factor` on each side, rounded up. There are fewer
    /// levels when one has a single pixel.
    pub(crate) fn new(screen: &Screen, factor: usize, levels: usize, reduce: Reduce) -> Self {
        let mut made: Vec<PyramidLevel> = Vec::new();
        let (mut width, mut height) = (screen.size().width() as usize, screen.size().height() as usize);
        let mut scale = 1;
        while made.len() < levels && (width > 1 || height > 1) {
            let below = made.last().map_or(screen.depths(), |level| &level.depth);
            let depth = reduced(below, [width, height], factor, reduce);
            (width, height) = (width.div_ceil(factor), height.div_ceil(factor));
            scale *= factor as i32;
            made.push(PyramidLevel { width, height, scale, depth });
        }
        Self { levels: made }
    }

    /// Returns the number of the highest level; 0 when there is only the screen.
    pub(crate) fn top(&self) -> usize {
        self.levels.len()
    }

    /// Returns the size on the heap in bytes.
    pub(crate) fn heap_bytes(&self) -> usize {
        self.levels.iter().map(|level| level.depth.len() * size_of::<f32>()).sum()
    }

    /// Returns the centre, in pixels of the screen's grid, and the depth of the pixel of `level` at `at`; `None` for
    /// sky and beyond the grid.
    #[inline]
    pub(crate) fn read(&self, screen: &Screen, level: usize, at: Vec2) -> Option<(Vec2, f32)> {
        let (x, y) = (at.x.floor() as i32, at.y.floor() as i32);
        let (scale, x, y, depth) = if level == 0 {
            (1, x, y, screen.depth(x, y))
        } else {
            let level = &self.levels[level - 1];
            // The division rounds down, so that places just left of the grid stay outside.
            let (x, y) = (x.div_euclid(level.scale), y.div_euclid(level.scale));
            let inside = (x as u32 as usize) < level.width && (y as u32 as usize) < level.height;
            (
                level.scale,
                x,
                y,
                if inside { level.depth[y as usize * level.width + x as usize] } else { f32::INFINITY },
            )
        };
        (depth < f32::INFINITY).then(|| ((Vec2::new(x as f32, y as f32) + 0.5) * scale as f32, depth))
    }
}

/// Returns the next level above `depth`, whose sides are `width` and `height`.
fn reduced(depth: &[f32], [width, height]: [usize; 2], factor: usize, reduce: Reduce) -> Vec<f32> {
    let small = width.div_ceil(factor);
    let mut made = vec![0.0; small * height.div_ceil(factor)];
    made.par_chunks_mut(small).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            *value = match reduce {
                Reduce::Pick => {
                    let [px, py] = [(x * factor + (y & 1 ^ 1), width), (y * factor + (x & 1 ^ 1), height)]
                        .map(|(at, side)| at.min(side - 1));
                    depth[py * width + px]
                }
                Reduce::Mean => {
                    let (right, bottom) =
                        ((x * factor + factor).min(width), (y * factor + factor).min(height));
                    let rows =
                        (y * factor..bottom).map(|y| &depth[y * width + x * factor..y * width + right]);
                    let count = (right - x * factor) * (bottom - y * factor);
                    rows.flatten().sum::<f32>() / count as f32
                }
            };
        }
    });
    made
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use psao_reconstruct::Size;

    use super::*;

    fn screen(width: u32, height: u32, depth: Vec<f32>) -> Screen {
        let normals = vec![Vec3::NEG_Z; depth.len()];
        Screen::from_parts(Size::new(width, height).unwrap(), 0, [1.0; 2], depth, normals).unwrap()
    }

    #[test]
    fn means_are_those_of_what_lies_below() {
        let depths: Vec<f32> = (1..=28).map(|v| v as f32).collect();
        let screen = screen(7, 4, depths.clone());
        let pyramid = DepthPyramid::new(&screen, 3, 9, Reduce::Mean);
        assert_eq!(pyramid.top(), 2, "7 x 4, 3 x 2, 1 x 1");
        assert_eq!(pyramid.heap_bytes(), 7 * 4);
        let mean = |xs: std::ops::Range<usize>, ys: std::ops::Range<usize>| {
            let all: Vec<f32> =
                ys.flat_map(|y| xs.clone().map(move |x| (y, x))).map(|(y, x)| depths[y * 7 + x]).collect();
            all.iter().sum::<f32>() / all.len() as f32
        };
        let read = |level, x, y| pyramid.read(&screen, level, Vec2::new(x, y));
        assert_eq!(read(1, 1.0, 2.9), Some((Vec2::new(1.5, 1.5), mean(0..3, 0..3))));
        assert_eq!(read(1, 6.9, 3.5), Some((Vec2::new(7.5, 4.5), mean(6..7, 3..4))));
        assert_eq!(read(0, 6.9, 3.5), Some((Vec2::new(6.5, 3.5), 28.0)));
        for (x, y) in [(-0.1, 1.0), (9.1, 1.0), (1.0, -3.0), (1.0, f32::MAX), (f32::NEG_INFINITY, 0.0)] {
            assert_eq!((read(0, x, y), read(1, x, y), read(2, x, y)), (None, None, None), "{x} {y}");
        }
    }

    #[test]
    fn sky_is_a_depth_without_end() {
        let mut depths = vec![2.0; 36];
        depths[0] = f32::INFINITY;
        let screen = screen(6, 6, depths);
        let pyramid = DepthPyramid::new(&screen, 3, 1, Reduce::Mean);
        assert_eq!(pyramid.read(&screen, 1, Vec2::new(1.0, 1.0)), None);
        assert_eq!(pyramid.read(&screen, 1, Vec2::new(4.0, 1.0)).unwrap().1, 2.0);
    }

    #[test]
    fn picks_are_depths_of_the_screen_on_a_turning_grid() {
        let screen = screen(5, 4, (1..=20).map(|v| v as f32).collect());
        let pyramid = DepthPyramid::new(&screen, 2, 2, Reduce::Pick);
        let row = |y: f32| [0.0, 2.0, 4.0].map(|x| pyramid.read(&screen, 1, Vec2::new(x, y)).unwrap().1);
        // Pixels (1, 1), (3, 0) and, beyond the side, (4, 1); below (0, 3), (2, 2), (4, 3).
        assert_eq!(row(0.0), [7.0, 4.0, 10.0]);
        assert_eq!(row(2.0), [16.0, 13.0, 20.0]);
    }

    #[test]
    fn one_pixel_has_no_levels() {
        let screen = screen(1, 1, vec![3.0]);
        let pyramid = DepthPyramid::new(&screen, 3, 4, Reduce::Mean);
        assert_eq!((pyramid.top(), pyramid.heap_bytes()), (0, 0));
        assert_eq!(pyramid.read(&screen, 0, Vec2::new(0.5, 0.5)), Some((Vec2::new(0.5, 0.5), 3.0)));
    }
}
