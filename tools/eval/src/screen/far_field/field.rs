//! The depth field as lines sample it.

use glam::Vec2;

use crate::screen::Screen;

/// The grid of a screen in square pixels: lengths that are equal on the screen are equal slopes, across and down.
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

    /// Half the grid in square pixels.
    pub(crate) fn half(&self) -> Vec2 {
        self.middle * self.scale
    }

    /// How often wider than high a pixel is, or the other way round; at least 1.
    pub(crate) fn stretch(&self) -> f32 {
        let ratio = self.scale.x / self.scale.y;
        ratio.max(1.0 / ratio)
    }

    /// Slope of one square pixel.
    #[inline]
    pub(crate) fn slope(&self) -> f32 {
        self.slope
    }

    /// Centre of pixel (`x`, `y`) of the grid in square pixels from the grid's middle.
    #[inline]
    pub(crate) fn place(&self, x: i32, y: i32) -> Vec2 {
        self.of_grid(Vec2::new(x as f32 + 0.5, y as f32 + 0.5))
    }

    /// A place of the grid, in pixels from its top left, in square pixels from its middle.
    #[inline]
    pub(crate) fn of_grid(&self, at: Vec2) -> Vec2 {
        (at - self.middle) * self.scale
    }

    /// The other way: pixels from the top left of the grid.
    #[inline]
    pub(crate) fn on_grid(&self, at: Vec2) -> Vec2 {
        at / self.scale + self.middle
    }
}

/// Inverse depths, which are linear over a plane: between four pixels of one plane lies that plane. Sky is 0.
#[derive(Clone, Debug)]
pub(crate) struct DepthField {
    pixels: SquarePixels,
    size: Vec2,
    stride: usize,
    /// With one more pixel on each side, the same as the last one.
    inverse: Vec<f32>,
    thickness: Option<f32>,
}

impl DepthField {
    /// Of a field that is `thickness` metres thick nothing is interpolated across a jump of more (section 11).
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

    pub(crate) fn bytes(&self) -> usize {
        self.inverse.len() * size_of::<f32>()
    }

    /// Whether the field goes on between two inverse depths: neither is sky, and they are not further apart than it is
    /// thick.
    #[inline]
    pub(crate) fn joins(&self, a: f32, b: f32) -> bool {
        let (near, far) = (a.max(b), a.min(b));
        // 1 / far - 1 / near against the thickness.
        far > 0.0 && self.thickness.is_none_or(|thickness| near - far <= thickness * near * far)
    }

    /// Inverse depth at a place in square pixels from the grid's middle; 0 for sky and beyond the grid.
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
        // An outline, of which each side is its own.
        if !self.joins(near, far) {
            let [left, right] = if part.y < 0.5 { [a, b] } else { [c, d] };
            return if part.x < 0.5 { left } else { right };
        }
        let (above, below) = (a + (b - a) * part.x, c + (d - c) * part.x);
        above + (below - above) * part.y
    }
}
