//! Separable approximation in groups of 3 x 3 pixels (Timonen, section 10, after Huang et al. 2011).

use glam::Vec3;
use psao_reconstruct::Size;
use rayon::prelude::*;

use crate::screen::Screen;

use super::slice::Receiver;

/// Smallest dot product of two normals in a group.
const MIN_NORMAL_DOT: f32 = 0.5;
/// Largest difference of two depths in a group, over the depth of its pixel.
const MAX_DEPTH_RATIO: f32 = 0.03;
/// Pixels to either side in the selective blur, and the largest difference of their values.
const BLUR_REACH: usize = 2;
const BLUR_THRESHOLD: f32 = 0.07;

/// The receiver for which a pixel gathers the far field, and the pixels from which it gathers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelAverage {
    /// Average of the accepted pixels.
    pub(crate) receiver: Receiver,
    /// Accepted pixels of the group: a bit for each, row by row.
    accepted: u16,
}

/// Returns the part of all sectors, 0 to 8, that an inner pixel evaluates.
#[inline]
pub(crate) fn part(x: usize, y: usize) -> usize {
    x % 3 + 3 * (y % 3)
}

/// Returns the first column or row of the group of a pixel. The pixel is in the middle of its group, except at the
/// border. There the group stays inside, so that it has all nine parts.
#[inline]
fn group_start(at: usize, len: usize) -> usize {
    at.saturating_sub(1).min(len.saturating_sub(3))
}

/// Returns the pixels of the group of pixel (`x`, `y`): their bits, columns and rows.
fn group(size: Size, x: usize, y: usize) -> impl Iterator<Item = (u16, usize, usize)> {
    let (width, height) = (size.width() as usize, size.height() as usize);
    let (left, top) = (group_start(x, width), group_start(y, height));
    let bit = move |x: usize, y: usize| 1 << (x - left + 3 * (y - top));
    (top..(top + 3).min(height))
        .flat_map(move |y| (left..(left + 3).min(width)).map(move |x| (bit(x, y), x, y)))
}

/// Kernel "Box average": averages positions and normals over the similar pixels of each group.
///
/// The paper averages depths. The mean of positions lies on the surface even for a group at the border, or with pixels
/// that are not accepted.
pub(crate) fn box_average(screen: &Screen) -> Vec<Option<PixelAverage>> {
    let guard = screen.guard() as i32;
    let mut out = vec![None; screen.inner().pixels()];
    out.par_chunks_mut(screen.inner().width() as usize).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            *out = average(screen, x, y, guard);
        }
    });
    out
}

fn average(screen: &Screen, x: usize, y: usize, guard: i32) -> Option<PixelAverage> {
    let on_grid = |x: usize, y: usize| (x as i32 + guard, y as i32 + guard);
    let (at_x, at_y) = on_grid(x, y);
    let depth = screen.position(at_x, at_y)?.z;
    let normal = screen.normal(at_x, at_y);
    let (mut accepted, mut positions, mut normals) = (0_u16, Vec3::ZERO, Vec3::ZERO);
    for (bit, x, y) in group(screen.inner(), x, y) {
        let (x, y) = on_grid(x, y);
        let Some(position) = screen.position(x, y) else { continue };
        let other = screen.normal(x, y);
        if other.dot(normal) > MIN_NORMAL_DOT && (position.z - depth).abs() < MAX_DEPTH_RATIO * depth {
            accepted |= bit;
            positions += position;
            normals += other;
        }
    }
    let position = positions / accepted.count_ones() as f32;
    Some(PixelAverage { receiver: Receiver::new(position, normals.normalize_or(normal)), accepted })
}

/// Kernel "Gather": adds to the near field of each pixel the mean far field of its group's accepted pixels, which
/// evaluate a ninth each.
pub(crate) fn gather(size: Size, averaged: &[Option<PixelAverage>], far: &[f32], near: &mut [f32]) {
    let width = size.width() as usize;
    near.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let Some(PixelAverage { accepted, .. }) = averaged[y * width + x] else { continue };
            let sum: f32 = group(size, x, y)
                .filter(|(bit, ..)| accepted & bit != 0)
                .map(|(_, x, y)| far[y * width + x])
                .sum();
            *value += sum * (9.0 / accepted.count_ones() as f32);
        }
    });
}

/// Applies the selective blur: the mean over those of 5 x 5 pixels whose value is at most 0.07 off.
pub(crate) fn blur(size: Size, averaged: &[Option<PixelAverage>], values: &[f32]) -> Vec<f32> {
    let (width, height) = (size.width() as usize, size.height() as usize);
    let mut out = values.to_vec();
    out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let centre = y * width + x;
            if averaged[centre].is_none() {
                continue;
            }
            let (mut sum, mut count) = (0.0_f32, 0.0_f32);
            for y in y.saturating_sub(BLUR_REACH)..(y + BLUR_REACH + 1).min(height) {
                for x in x.saturating_sub(BLUR_REACH)..(x + BLUR_REACH + 1).min(width) {
                    let at = y * width + x;
                    if averaged[at].is_some() && (values[at] - values[centre]).abs() <= BLUR_THRESHOLD {
                        sum += values[at];
                        count += 1.0;
                    }
                }
            }
            *out = sum / count;
        }
    });
    out
}
