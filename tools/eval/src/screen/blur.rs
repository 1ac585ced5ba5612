//! Separable blurs that stop at edges. Every noisy method ends with one, with the settings of its paper.

use glam::Vec3;
use rayon::prelude::*;

use super::{Screen, ScreenError, check_setting};

/// A Gaussian over rows, then over columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blur {
    /// Taps on each side of the centre, 0 to 64; 0 is no blur.
    pub taps: u32,
    /// Pixels from tap to tap, 1 to 64.
    pub spacing: u32,
    /// Standard deviation of the Gaussian in taps, above 0 (at least 1e-3) and at most 1000.
    pub sigma: f32,
    /// Edges at which it stops.
    pub edge: EdgeStop,
}

/// Edge-stopping function: the factor of the Gaussian's weight for a tap whose depth differs by `d` metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeStop {
    /// 1 everywhere, also over sky.
    None,
    /// `exp(-(d / metres)^2)`: the cross-bilateral blur of HBAO (Bavoil and Sainz 2008).
    Depth {
        /// Difference that leaves 1/e.
        metres: f32,
    },
    /// `max(0, 1 - d / metres)`: Scalable Ambient Obscurance (`McGuire` et al. 2012).
    Hat {
        /// Difference that leaves 0.
        metres: f32,
    },
    /// `exp(-(d / metres)^2)`, times the cosine between the normals to the power of 8: depth and normal, as Filion
    /// and `McNaughton` (2008) have it.
    DepthAndNormal {
        /// Difference that leaves 1/e.
        metres: f32,
    },
}

impl Blur {
    /// No blur.
    pub const NONE: Self = Self { taps: 0, spacing: 1, sigma: 1.0, edge: EdgeStop::None };

    /// Checks the ranges. Errors name `method`.
    ///
    /// # Errors
    ///
    /// [`ScreenError::Setting`].
    pub fn validate(&self, method: &'static str) -> Result<(), ScreenError> {
        check_setting(method, "taps of the blur", self.taps as f32, 0.0, 64.0)?;
        check_setting(method, "spacing of the blur", self.spacing as f32, 1.0, 64.0)?;
        check_setting(method, "sigma of the blur", self.sigma, 1e-3, 1e3)?;
        match self.edge {
            EdgeStop::None => Ok(()),
            EdgeStop::Depth { metres } | EdgeStop::Hat { metres } | EdgeStop::DepthAndNormal { metres } => {
                check_setting(method, "edge of the blur", metres, 1e-6, 1e6)
            }
        }
    }

    /// Returns its name in words.
    pub fn label(&self) -> String {
        let width = 2 * self.taps + 1;
        match (self.taps, self.edge) {
            (0, _) => "no blur".to_owned(),
            (_, EdgeStop::None) => format!("Gaussian of {width}"),
            _ => format!("bilateral of {width}"),
        }
    }

    /// Returns the bytes that [`Blur::apply`] needs beside the values.
    pub(crate) fn heap_bytes(&self, screen: &Screen) -> usize {
        if self.taps == 0 { 0 } else { screen.inner().pixels() * size_of::<f32>() }
    }

    /// Blurs the values of the inner pixels. Sky keeps its values; taps beyond the image are left out.
    pub(crate) fn apply(&self, screen: &Screen, values: &mut [f32]) {
        if self.taps == 0 {
            return;
        }
        let spread = 2.0 * self.sigma * self.sigma;
        let weights: Vec<f32> =
            (0..=self.taps).map(|tap| libm::expf(-((tap * tap) as f32) / spread)).collect();
        let mut blurred = vec![0.0; values.len()];
        self.pass(screen, values, &mut blurred, &weights, [1, 0]);
        self.pass(screen, &blurred, values, &weights, [0, 1]);
    }

    /// Does one pass, along rows or columns.
    fn pass(&self, screen: &Screen, from: &[f32], to: &mut [f32], weights: &[f32], [across, down]: [i32; 2]) {
        let (width, height) = (screen.inner().width() as i32, screen.inner().height() as i32);
        let guard = screen.guard() as i32;
        to.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
            let y = y as i32;
            for (value, x) in row.iter_mut().zip(0_i32..) {
                let here = from[(y * width + x) as usize];
                let depth = screen.depth(x + guard, y + guard);
                if depth == f32::INFINITY {
                    *value = here;
                    continue;
                }
                let normal = screen.normal(x + guard, y + guard);
                let (mut sum, mut total) = (here * weights[0], weights[0]);
                for (tap, weight) in (1_i32..).zip(&weights[1..]) {
                    let step = tap * self.spacing as i32;
                    for side in [-step, step] {
                        let (tx, ty) = (x + side * across, y + side * down);
                        if !(0..width).contains(&tx) || !(0..height).contains(&ty) {
                            continue;
                        }
                        let there = screen.depth(tx + guard, ty + guard);
                        let weight = weight
                            * self
                                .edge
                                .weight(there - depth, normal, || screen.normal(tx + guard, ty + guard));
                        sum += from[(ty * width + tx) as usize] * weight;
                        total += weight;
                    }
                }
                *value = sum / total;
            }
        });
    }
}

impl EdgeStop {
    /// Returns the factor of a tap whose depth differs by `difference` metres; the difference is infinite for sky.
    #[inline]
    fn weight(self, difference: f32, normal: Vec3, there: impl Fn() -> Vec3) -> f32 {
        let gauss = |metres: f32| {
            let over = difference / metres;
            libm::expf(-over * over)
        };
        match self {
            Self::None => 1.0,
            Self::Depth { metres } => gauss(metres),
            Self::Hat { metres } => (1.0 - difference.abs() / metres).max(0.0),
            Self::DepthAndNormal { metres } => {
                let cosine = normal.dot(there()).max(0.0);
                let square = cosine * cosine;
                gauss(metres) * (square * square) * (square * square)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;

    use super::*;
    use crate::reference::mix;

    fn screen(depths: &dyn Fn(u32, u32) -> f32) -> Screen {
        let depth = (0..14).flat_map(|y| (0..18).map(move |x| (x, y))).map(|(x, y)| depths(x, y)).collect();
        let normals = (0..14 * 18).map(|i| if i % 5 < 3 { Vec3::NEG_Z } else { Vec3::Y });
        Screen::from_parts(Size::new(14, 10).unwrap(), 2, [1.0, 0.7], depth, normals.collect()).unwrap()
    }

    fn noise() -> Vec<f32> {
        (0..140).map(|i| (mix(i) % 1000) as f32 / 1000.0).collect()
    }

    const EDGES: [EdgeStop; 4] = [
        EdgeStop::None,
        EdgeStop::Depth { metres: 0.3 },
        EdgeStop::Hat { metres: 0.3 },
        EdgeStop::DepthAndNormal { metres: 0.3 },
    ];

    /// Compares with a single sum over the square of taps, which is exact where no edge is near.
    #[test]
    fn two_passes_are_the_square_of_taps_where_nothing_stops_them() {
        let screen = screen(&|_, _| 3.0);
        for edge in [EdgeStop::None, EdgeStop::Depth { metres: 0.3 }, EdgeStop::Hat { metres: 0.3 }] {
            let blur = Blur { taps: 2, spacing: 2, sigma: 1.5, edge };
            let from = noise();
            let mut values = from.clone();
            blur.apply(&screen, &mut values);
            for (y, x) in (0..10).flat_map(|y| (0..14).map(move |x| (y, x))) {
                let (mut sum, mut total) = (0.0, 0.0);
                for (j, i) in (-2_i32..=2).flat_map(|j| (-2_i32..=2).map(move |i| (j, i))) {
                    let (tx, ty) = (x + 2 * i, y + 2 * j);
                    if (0..14).contains(&tx) && (0..10).contains(&ty) {
                        let weight = libm::exp(-f64::from(i * i + j * j) / 4.5);
                        sum += weight * f64::from(from[(ty * 14 + tx) as usize]);
                        total += weight;
                    }
                }
                let apart = f64::from(values[(y * 14 + x) as usize]) - sum / total;
                assert!(apart.abs() < 1e-6, "{edge:?} at {x} {y}: {apart}");
            }
        }
    }

    #[test]
    fn what_is_even_stays_so_and_sky_keeps_its_own() {
        let screen = screen(&|x, y| if (x + y) % 7 == 0 { f32::INFINITY } else { 1.0 + x as f32 });
        for edge in EDGES {
            let blur = Blur { taps: 3, spacing: 1, sigma: 2.0, edge };
            let mut values = vec![0.25; 140];
            blur.apply(&screen, &mut values);
            assert!(values.iter().all(|v| (v - 0.25).abs() < 1e-6), "{edge:?}");
            let mut values = noise();
            blur.apply(&screen, &mut values);
            for (pixel, (value, before)) in values.iter().zip(noise()).enumerate() {
                assert!((0.0..=1.0).contains(value));
                let sky = (pixel % 14 + pixel / 14 + 4) % 7 == 0;
                assert!(!sky || *value == before);
            }
        }
    }

    #[test]
    fn nothing_crosses_an_edge() {
        let screen = screen(&|x, _| if x < 9 { 2.0 } else { 6.0 });
        for edge in &EDGES[1..] {
            let mut values: Vec<f32> = (0..140).map(|i| if i % 14 < 7 { 0.0 } else { 1.0 }).collect();
            Blur { taps: 4, spacing: 1, sigma: 3.0, edge: *edge }.apply(&screen, &mut values);
            assert!((0..140).all(|i| values[i] == if i % 14 < 7 { 0.0 } else { 1.0 }), "{edge:?}");
        }
        let mut values: Vec<f32> = (0..140).map(|i| if i % 14 < 7 { 0.0 } else { 1.0 }).collect();
        Blur { taps: 4, spacing: 1, sigma: 3.0, edge: EdgeStop::None }.apply(&screen, &mut values);
        assert!(values[6] > 0.2 && values[7] < 0.8);
    }

    #[test]
    fn settings_out_of_range_are_refused_in_the_name_of_the_method() {
        let good = Blur { taps: 2, spacing: 1, sigma: 1.5, edge: EdgeStop::Hat { metres: 1.0 } };
        assert_eq!(good.validate("x"), Ok(()));
        let bad = [
            Blur { taps: 65, ..good },
            Blur { spacing: 0, ..good },
            Blur { sigma: 0.0, ..good },
            Blur { sigma: f32::NAN, ..good },
            Blur { edge: EdgeStop::Depth { metres: -1.0 }, ..good },
        ];
        for blur in bad {
            assert!(matches!(blur.validate("x"), Err(ScreenError::Setting { method: "x", .. })), "{blur:?}");
        }
    }
}
