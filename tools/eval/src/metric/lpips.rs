//! LPIPS: Zhang, Isola, Efros, Shechtman, Wang, *The Unreasonable Effectiveness of Deep Features as a Perceptual
//! Metric* (2018), version 0.1 over `AlexNet`.
//!
//! The weights are not part of this crate; the caller provides them, see [`Lpips::from_weights`].

use half::f16;
use psao_reconstruct::AoImage;
use rayon::prelude::*;

use super::{MetricError, size_of_at_least};

/// A convolution: numbers of input and output planes, side of the square kernel, stride, and zero padding.
struct Convolution {
    planes_in: usize,
    planes_out: usize,
    side: usize,
    stride: usize,
    pad: usize,
}

/// `AlexNet`'s convolutions (Krizhevsky 2014). Max pooling halves the planes after the first two.
const CONVOLUTIONS: [Convolution; 5] = [
    Convolution { planes_in: 3, planes_out: 64, side: 11, stride: 4, pad: 2 },
    Convolution { planes_in: 64, planes_out: 192, side: 5, stride: 1, pad: 2 },
    Convolution { planes_in: 192, planes_out: 384, side: 3, stride: 1, pad: 1 },
    Convolution { planes_in: 384, planes_out: 256, side: 3, stride: 1, pad: 1 },
    Convolution { planes_in: 256, planes_out: 256, side: 3, stride: 1, pad: 1 },
];
const POOLED_LAYERS: usize = 2;

/// Offsets that the network subtracts from red, green and blue in `[-1, 1]`, and their divisors.
const CHANNEL_SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const CHANNEL_SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// The network with its weights.
pub struct Lpips {
    layers: Vec<Layer>,
}

/// A convolution with its weights, and the weights of its planes in the distance.
struct Layer {
    shape: &'static Convolution,
    /// Weights by output plane, input plane, row and column.
    weights: Vec<f32>,
    bias: Vec<f32>,
    /// Weights of the planes in the distance, by output plane.
    head: Vec<f32>,
}

/// Error of reading the network's weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsError {
    /// The number of bytes is wrong.
    #[error(
        "weights of LPIPS (AlexNet, version 0.1) are {} half floats or as many floats, little endian; {found} bytes are \
         neither",
        Lpips::WEIGHT_COUNT
    )]
    Length {
        /// Number of given bytes.
        found: usize,
    },
    /// A weight is infinite or not a number.
    #[error("weight {index} is not a finite number; the file is damaged, or of another format")]
    Value {
        /// Position of the weight, from 0.
        index: usize,
    },
}

impl Lpips {
    /// Number of weights in a file.
    pub const WEIGHT_COUNT: usize = 2_470_848;

    /// Smallest side of an image in pixels that leaves a pixel after the first two convolutions.
    pub const MIN_SIDE: u32 = 31;

    /// Makes the network from its weights: [`WEIGHT_COUNT`](Self::WEIGHT_COUNT) numbers of 2 or 4 bytes, little endian.
    ///
    /// The five convolutions of `AlexNet` come first, then the five heads. A convolution has its kernels (plane out,
    /// plane in, row, column) and then its biases.
    ///
    /// # Errors
    ///
    /// [`WeightsError`] when the bytes are too few, too many, or not finite.
    pub fn from_weights(bytes: &[u8]) -> Result<Self, WeightsError> {
        let numbers: Vec<f32> = if bytes.len() == Self::WEIGHT_COUNT * 2 {
            bytes.as_chunks().0.iter().map(|bytes| f16::from_le_bytes(*bytes).to_f32()).collect()
        } else if bytes.len() == Self::WEIGHT_COUNT * 4 {
            bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
        } else {
            return Err(WeightsError::Length { found: bytes.len() });
        };
        if let Some(index) = numbers.iter().position(|number| !number.is_finite()) {
            return Err(WeightsError::Value { index });
        }
        let mut rest = numbers.as_slice();
        let mut take = |count: usize| {
            let (taken, left) = rest.split_at(count);
            rest = left;
            taken.to_vec()
        };
        let kernels: Vec<_> = CONVOLUTIONS
            .iter()
            .map(|shape| {
                let count = shape.planes_out * shape.planes_in * shape.side * shape.side;
                (shape, take(count), take(shape.planes_out))
            })
            .collect();
        let layers = kernels.into_iter().map(|(shape, weights, bias)| {
            let head = take(shape.planes_out);
            Layer { shape, weights, bias, head }
        });
        Ok(Self { layers: layers.collect() })
    }

    /// Returns the distance of `test` from `reference`, at least 0, seldom above 1; 0 for equal images, lower is
    /// better. AO counts as sRGB grey.
    ///
    /// # Errors
    ///
    /// [`MetricError::Size`] when the images differ in size, [`MetricError::TooSmall`] below
    /// [`MIN_SIDE`](Self::MIN_SIDE) pixels a side.
    pub fn distance(&self, reference: &AoImage, test: &AoImage) -> Result<f64, MetricError> {
        size_of_at_least("LPIPS", Self::MIN_SIDE, reference, test)?;
        let mut planes = [reference, test].map(Planes::of);
        let mut distance = 0.0;
        for (index, layer) in self.layers.iter().enumerate() {
            if (1..=POOLED_LAYERS).contains(&index) {
                planes = planes.map(|planes| planes.max_pooled());
            }
            planes = planes.map(|planes| layer.convolve(&planes));
            distance += layer.distance(&planes);
        }
        Ok(distance)
    }
}

/// Planes of equal size, each row by row.
struct Planes {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Planes {
    /// Returns the network's input for an image: three planes of grey.
    fn of(image: &AoImage) -> Self {
        let plane = |(shift, scale): (f32, f32)| {
            image.values().iter().map(move |value| (value * 2.0 - 1.0 - shift) / scale)
        };
        Self {
            width: image.size().width() as usize,
            height: image.size().height() as usize,
            values: CHANNEL_SHIFT.into_iter().zip(CHANNEL_SCALE).flat_map(plane).collect(),
        }
    }

    fn planes(&self) -> std::slice::ChunksExact<'_, f32> {
        self.values.chunks_exact(self.width * self.height)
    }

    /// Returns the planes with zeros around each.
    fn padded(&self, pad: usize) -> Self {
        let (width, height) = (self.width + 2 * pad, self.height + 2 * pad);
        let planes = self.values.len() / (self.width * self.height);
        let mut values = vec![0.0; planes * width * height];
        for (to, from) in values.chunks_exact_mut(width * height).zip(self.planes()) {
            for (row, from) in to.chunks_exact_mut(width).skip(pad).zip(from.chunks_exact(self.width)) {
                row[pad..pad + self.width].copy_from_slice(from);
            }
        }
        Self { width, height, values }
    }

    /// Returns the maximum of every 3 x 3 values, in steps of 2.
    fn max_pooled(&self) -> Self {
        let (width, height) = ((self.width - 3) / 2 + 1, (self.height - 3) / 2 + 1);
        let mut values = Vec::with_capacity(self.values.len() / (self.width * self.height) * width * height);
        for plane in self.planes() {
            for y in 0..height {
                for x in 0..width {
                    let rows = (0..3).map(|row| &plane[(y * 2 + row) * self.width + x * 2..][..3]);
                    values.push(rows.flatten().copied().fold(f32::MIN, f32::max));
                }
            }
        }
        Self { width, height, values }
    }
}

impl Layer {
    /// Applies the convolution and sets negative values to 0.
    fn convolve(&self, planes: &Planes) -> Planes {
        let Convolution { planes_in, side, stride, pad, .. } = *self.shape;
        let input = planes.padded(pad);
        let (width, height) = ((input.width - side) / stride + 1, (input.height - side) / stride + 1);
        let mut values = vec![0.0; self.bias.len() * width * height];
        let kernels = self.weights.par_chunks_exact(planes_in * side * side).zip(&self.bias);
        values.par_chunks_exact_mut(width * height).zip(kernels).for_each(|(out, (kernel, bias))| {
            out.fill(*bias);
            for (plane, kernel) in input.planes().zip(kernel.chunks_exact(side * side)) {
                for (tap, weight) in kernel.iter().enumerate() {
                    for (y, row) in out.chunks_exact_mut(width).enumerate() {
                        let from = &plane[(y * stride + tap / side) * input.width + tap % side..];
                        if stride == 1 {
                            row.iter_mut().zip(from).for_each(|(sum, value)| *sum += weight * value);
                        } else {
                            let from = from.iter().step_by(stride);
                            row.iter_mut().zip(from).for_each(|(sum, value)| *sum += weight * value);
                        }
                    }
                }
            }
            out.iter_mut().for_each(|value| *value = value.max(0.0));
        });
        Planes { width, height, values }
    }

    /// Returns the mean over the places of the weighted squared difference of the planes, normalised at each place.
    fn distance(&self, pair: &[Planes; 2]) -> f64 {
        let places = pair[0].width * pair[0].height;
        let lengths = pair.each_ref().map(|planes| {
            let mut squares = vec![0.0_f64; places];
            for plane in planes.planes() {
                squares.iter_mut().zip(plane).for_each(|(sum, value)| *sum += f64::from(value * value));
            }
            squares.into_iter().map(|sum| sum.sqrt() + 1e-10).collect::<Vec<_>>()
        });
        let mut sum = 0.0;
        for ((first, second), weight) in pair[0].planes().zip(pair[1].planes()).zip(&self.head) {
            let pairs = first.iter().zip(&lengths[0]).zip(second.iter().zip(&lengths[1]));
            let squares = pairs.map(|((a, of_a), (b, of_b))| {
                let difference = f64::from(*a) / of_a - f64::from(*b) / of_b;
                difference * difference
            });
            sum += f64::from(*weight) * squares.sum::<f64>();
        }
        sum / places as f64
    }
}

#[cfg(test)]
mod tests {
    use psao_reconstruct::Size;

    use super::*;

    #[test]
    fn weights_of_another_size_or_not_finite_are_refused() {
        for found in [0, 1, Lpips::WEIGHT_COUNT * 2 - 1, Lpips::WEIGHT_COUNT * 4 + 1] {
            let refused = Lpips::from_weights(&vec![0; found]).err();
            assert_eq!(refused, Some(WeightsError::Length { found }));
        }
        let mut bytes = vec![0; Lpips::WEIGHT_COUNT * 2];
        bytes[20..22].copy_from_slice(&f16::NAN.to_le_bytes());
        assert_eq!(Lpips::from_weights(&bytes).err(), Some(WeightsError::Value { index: 10 }));
    }

    #[test]
    fn the_shapes_use_up_the_weights() {
        let numbers = |shape: &Convolution| {
            shape.planes_out * (shape.planes_in * shape.side * shape.side + 2) // kernel, bias, head
        };
        assert_eq!(CONVOLUTIONS.iter().map(numbers).sum::<usize>(), Lpips::WEIGHT_COUNT);
    }

    /// Compares a layer of arbitrary weights with loops that follow the definition.
    #[test]
    fn a_convolution_equals_its_definition() {
        let shape = &CONVOLUTIONS[2];
        let number = |index: usize| (index * 2_654_435_761 % 1_000) as f32 / 1_000.0 - 0.5;
        let (width, height) = (5, 4);
        let planes = Planes { width, height, values: (0..192 * width * height).map(number).collect() };
        let weights: Vec<f32> = (0..384 * 192 * 9).map(number).collect();
        let bias: Vec<f32> = (0..384).map(number).collect();
        let layer = Layer { shape, weights: weights.clone(), bias: bias.clone(), head: Vec::new() };
        let found = layer.convolve(&planes);
        for (out, x, y) in [(0, 0, 0), (7, 4, 3), (383, 2, 1)] {
            let mut sum = f64::from(bias[out]);
            for plane in 0..192 {
                for (tap, (dy, dx)) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dy, dx))).enumerate() {
                    let (x, y) = (x + dx, y + dy);
                    if (1..=width).contains(&x) && (1..=height).contains(&y) {
                        let value = planes.values[(plane * height + y - 1) * width + x - 1];
                        sum += f64::from(weights[(out * 192 + plane) * 9 + tap] * value);
                    }
                }
            }
            let here = f64::from(found.values[(out * height + y) * width + x]);
            assert!((here - sum.max(0.0)).abs() < 1e-3, "{here} {sum}");
        }
    }

    #[test]
    fn the_least_side_is_the_least() {
        let network = Lpips::from_weights(&vec![0; Lpips::WEIGHT_COUNT * 2]).unwrap();
        let grey =
            |side| AoImage::new(Size::new(side, side).unwrap(), vec![0.5; (side * side) as usize]).unwrap();
        let of = |side| network.distance(&grey(side), &grey(side));
        assert_eq!(of(Lpips::MIN_SIDE).unwrap(), 0.0);
        assert!(matches!(of(Lpips::MIN_SIDE - 1), Err(MetricError::TooSmall { .. })));
    }
}
