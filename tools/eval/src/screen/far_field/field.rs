//! The depth field, sampled at any place.

use glam::Vec2;

use crate::screen::Screen;

/// The grid of a screen in square pixels: equal lengths are equal slopes, across and down.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SquarePixels {
    /// Half the grid, in pixels.
    middle: Vec2,
    /// Square pixels per pixel, across and down.
    scale: Vec2,
    /// Slope of one square pixel.
    slope: f32,
}

impl SquarePixels {
    pub(crate) fn new(screen: &Screen) -> Self {
        let focal = screen.radius_px(1.0, 1.0);
        let size = Vec2::new(screen.size().width() as f32, screen.size().height() as f32);
        let stretch = (focal.y / focal.x).sqrt();
        Self {
            middle: size * 0.5,
            scale: Vec2::new(stretch, 1.0 / stretch),
            slope: 1.0 / (focal.x * focal.y).sqrt(),
        }
    }

    /// Returns half the size of the grid in square pixels.
    pub(crate) fn half(&self) -> Vec2 {
        self.middle * self.scale
    }

    /// Returns the ratio of a pixel's longer side to its shorter side.
    pub(crate) fn stretch(&self) -> f32 {
        let ratio = self.scale.x / self.scale.y;
        ratio.max(1.0 / ratio)
    }

    /// Returns the slope of one square pixel.
    #[inline]
    pub(crate) fn slope(&self) -> f32 {
        self.slope
    }

    /// Returns the centre of pixel (`x`, `y`) of the grid in square pixels from the grid's middle.
    #[inline]
    pub(crate) fn place(&self, x: i32, y: i32) -> Vec2 {
        self.of_grid(Vec2::new(x as f32 + 0.5, y as f32 + 0.5))
    }

    /// Converts pixels from the top left of the grid to square pixels from its middle.
    #[inline]
    pub(crate) fn of_grid(&self, at: Vec2) -> Vec2 {
        (at - self.middle) * self.scale
    }

    /// Converts square pixels from the middle of the grid to pixels from its top left.
    #[inline]
    pub(crate) fn on_grid(&self, at: Vec2) -> Vec2 {
        at / self.scale + self.middle
    }
}

/// Inverse depths; sky is 0. They are linear over a plane, so interpolation between pixels of a plane gives that plane.
#[derive(Clone, Debug)]
pub(crate) struct DepthField {
    pixels: SquarePixels,
    size: Vec2,
    stride: usize,
    /// Padded by one pixel on each side with the value of the last pixel.
    inverse: Vec<f32>,
    thickness: Option<f32>,
}

impl DepthField {
    /// Makes the field of a screen. A field of `thickness` metres is not interpolated across larger jumps (section 11).
    pub(crate) fn new(screen: &Screen, thickness: Option<f32>) -> Self {
        let (width, height) = (screen.size().width() as usize, screen.size().height() as usize);
        let mut inverse = Vec::with_capacity((width + 2) * (height + 2));
        for y in 0..height + 2 {
            let from = y.saturating_sub(1).min(height - 1) * width;
            let row = &screen.depths()[from..from + width];
            let padded = row[..1].iter().chain(row).chain(&row[width - 1..]);
            inverse.extend(padded.map(|depth| 1.0 / depth));
        }
        Self {
            pixels: SquarePixels::new(screen),
            size: Vec2::new(width as f32, height as f32),
            stride: width + 2,
            inverse,
            thickness,
        }
    }

    pub(crate) fn pixels(&self) -> &SquarePixels {
        &self.pixels
    }

    pub(crate) fn heap_bytes(&self) -> usize {
        self.inverse.len() * size_of::<f32>()
    }

    /// Returns whether the field is continuous between two inverse depths: neither is sky, and their distance is at
    /// most the thickness.
    #[inline]
    pub(crate) fn joins(&self, a: f32, b: f32) -> bool {
        let (near, far) = (a.max(b), a.min(b));
        // 1 / far - 1 / near against the thickness.
        far > 0.0 && self.thickness.is_none_or(|thickness| near - far <= thickness * near * far)
    }

    /// Returns the inverse depth at a place in square pixels from the grid's middle; 0 for sky and beyond the grid.
    #[inline]
    pub(crate) fn inverse(&self, at: Vec2) -> f32 {
        let at = self.pixels.on_grid(at);
        if !(at.x >= 0.0 && at.y >= 0.0 && at.x < self.size.x && at.y < self.size.y) {
            return 0.0;
        }
        let at = at + 0.5;
        let (x, y) = (at.x as usize, at.y as usize);
        let part = at - Vec2::new(x as f32, y as f32);
        let [a, b] = [self.inverse[y * self.stride + x], self.inverse[y * self.stride + x + 1]];
        let [c, d] = [self.inverse[(y + 1) * self.stride + x], self.inverse[(y + 1) * self.stride + x + 1]];
        let (near, far) = (a.max(b).max(c.max(d)), a.min(b).min(c.min(d)));
        // At an outline, each side keeps its own depth.
        if !self.joins(near, far) {
            let [left, right] = if part.y < 0.5 { [a, b] } else { [c, d] };
            return if part.x < 0.5 { left } else { right };
        }
        let (above, below) = (a + (b - a) * part.x, c + (d - c) * part.x);
        above + (below - above) * part.y
    }
}
