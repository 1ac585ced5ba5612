//! Falloffs: the weight of an occluder by its distance.

use std::sync::Arc;

use super::ScreenError;

/// Weight of an occluder by its distance over the radius R: 1 at 0, 0 from 1 on, and never rising between.
///
/// All methods share it, so that their pictures differ by the method and not by the estimated quantity. Obscurance is
/// the cosine-weighted mean of the weights of the hits; accessibility is 1 minus obscurance.
#[derive(Clone, Debug, PartialEq)]
pub enum Falloff {
    /// `1 - s`: the ray tracer's obscurance ([`Occlusion::Obscurance`](psao_server::ao::Occlusion)), and the
    /// attenuation of Pyramid HBAO (Astapov et al. 2021, Eq. 7).
    Linear,
    /// 1 below R: the ray tracer's [`Occlusion::Binary`](psao_server::ao::Occlusion), ambient occlusion proper.
    Binary,
    /// `1 - s^2`: HBAO (Bavoil and Sainz 2008).
    Quadratic,
    /// `(1 - s^2)^3`: Scalable Ambient Obscurance (`McGuire` et al. 2012).
    Cubic,
    /// `exp(-decay s)`, shifted and scaled to reach 0 at R. Far-field obscurance is shown with it (Timonen 2013,
    /// section 8). `decay` is in `(0, 50]`.
    Exponential {
        /// Rate of decay per radius.
        decay: f32,
    },
    /// Samples at equal steps from 0 to R, joined by straight lines. [`Falloff::sampled`] makes one.
    Sampled(Samples),
}

/// Checked samples of a falloff.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples(Arc<[f32]>);

impl Falloff {
    /// Largest number of samples of [`Falloff::sampled`].
    pub const MAX_SAMPLES: usize = 65_536;
    /// Largest rate of [`Falloff::Exponential`].
    pub const MAX_DECAY: f32 = 50.0;

    /// Makes a falloff of any shape from at least two samples in `[0, 1]` at equal steps from 0 to R. From R on it is
    /// 0, whatever the last sample.
    ///
    /// # Errors
    ///
    /// [`ScreenError::Falloff`] when there are too few or too many samples, or one is not in `[0, 1]`.
    /// [`ScreenError::NotMonotone`] when a sample is above the one before. With such a falloff, methods that search the
    /// largest weighted occluder, or keep a horizon, would be silently wrong.
    pub fn sampled(samples: &[f32]) -> Result<Self, ScreenError> {
        if !(2..=Self::MAX_SAMPLES).contains(&samples.len()) {
            return Err(ScreenError::Falloff { what: "the number of samples", value: samples.len() as f32 });
        }
        if let Some(&value) = samples.iter().find(|v| !(0.0..=1.0).contains(*v)) {
            return Err(ScreenError::Falloff { what: "a sample", value });
        }
        if let Some(at) = samples.windows(2).position(|pair| pair[1] > pair[0]) {
            return Err(ScreenError::NotMonotone {
                sample: at + 1,
                before: samples[at],
                value: samples[at + 1],
            });
        }
        Ok(Self::Sampled(Samples(samples.into())))
    }

    /// Checks the parameters. Every falloff that passes is monotone.
    ///
    /// # Errors
    ///
    /// [`ScreenError::Falloff`] when the rate of decay is out of its range.
    pub fn validate(&self) -> Result<(), ScreenError> {
        match self {
            Self::Exponential { decay } if !(*decay > 0.0 && *decay <= Self::MAX_DECAY) => {
                Err(ScreenError::Falloff { what: "the decay", value: *decay })
            }
            _ => Ok(()),
        }
    }

    /// Returns the weight at `s`, a distance over the radius, in `[0, 1]`; 0 from 1 on, and for NaN. Below 0 counts as
    /// 0.
    #[inline]
    pub fn weight(&self, s: f32) -> f32 {
        if s.is_nan() || s >= 1.0 {
            return 0.0;
        }
        let s = s.max(0.0);
        match self {
            Self::Linear => 1.0 - s,
            Self::Binary => 1.0,
            Self::Quadratic => 1.0 - s * s,
            Self::Cubic => {
                let inner = 1.0 - s * s;
                inner * inner * inner
            }
            Self::Exponential { decay } => {
                let end = libm::expf(-decay);
                ((libm::expf(-decay * s) - end) / (1.0 - end)).max(0.0)
            }
            Self::Sampled(Samples(samples)) => {
                let along = s * (samples.len() - 1) as f32;
                let index = (along as usize).min(samples.len() - 2);
                let part = along - index as f32;
                samples[index] + (samples[index + 1] - samples[index]) * part
            }
        }
    }

    /// Returns its name for texts and plots.
    pub fn label(&self) -> String {
        match self {
            Self::Linear => "linear falloff".to_owned(),
            Self::Binary => "no falloff".to_owned(),
            Self::Quadratic => "quadratic falloff".to_owned(),
            Self::Cubic => "cubic falloff".to_owned(),
            Self::Exponential { decay } => format!("exponential falloff {decay}"),
            Self::Sampled(Samples(samples)) => format!("falloff of {} samples", samples.len()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all() -> [Falloff; 7] {
        let exponential = |decay| Falloff::Exponential { decay };
        let sampled = Falloff::sampled(&[1.0, 0.5, 0.5, 0.25]).unwrap();
        [
            Falloff::Linear,
            Falloff::Binary,
            Falloff::Quadratic,
            Falloff::Cubic,
            exponential(3.0),
            exponential(Falloff::MAX_DECAY),
            sampled,
        ]
    }

    #[test]
    fn all_start_at_one_and_end_at_zero() {
        for falloff in all() {
            assert_eq!(falloff.validate(), Ok(()));
            assert_eq!([-1.0, 0.0].map(|s| falloff.weight(s)), [1.0; 2], "{falloff:?}");
            let gone = [1.0, 7.0, f32::INFINITY, f32::NAN].map(|s| falloff.weight(s));
            assert_eq!(gone, [0.0; 4], "{falloff:?}");
        }
    }

    #[test]
    fn weights_are_those_of_the_formulas() {
        let at = |falloff: &Falloff| falloff.weight(0.5);
        let [linear, binary, quadratic, cubic, exponential, _, sampled] = all();
        assert_eq!([linear, binary, quadratic, sampled].map(|f| at(&f)), [0.5, 1.0, 0.75, 0.5]);
        assert_eq!(at(&cubic), 0.421_875);
        let want = (libm::exp(-1.5) - libm::exp(-3.0)) / (1.0 - libm::exp(-3.0));
        assert!((f64::from(at(&exponential)) - want).abs() < 1e-6);
        let ramp = Falloff::sampled(&[1.0, 0.0]).unwrap();
        assert_eq!(ramp.weight(0.25), 0.75);
    }

    #[test]
    fn what_rises_or_is_out_of_range_is_refused() {
        let rising = Falloff::sampled(&[1.0, 0.2, 0.3]);
        assert_eq!(rising, Err(ScreenError::NotMonotone { sample: 2, before: 0.2, value: 0.3 }));
        for samples in [&[][..], &[1.0], &[1.0, -0.1], &[1.5, 1.0], &[1.0, f32::NAN]] {
            assert!(matches!(Falloff::sampled(samples), Err(ScreenError::Falloff { .. })), "{samples:?}");
        }
        for decay in [0.0, -1.0, 51.0, f32::NAN] {
            let falloff = Falloff::Exponential { decay };
            assert!(matches!(falloff.validate(), Err(ScreenError::Falloff { .. })), "{decay}");
        }
    }

    proptest! {
        #[test]
        fn none_ever_rises(near in 0.0_f32..1.2, further in 0.0_f32..1.2) {
            for falloff in all() {
                let [a, b] = [near, near + further].map(|s| falloff.weight(s));
                prop_assert!(b <= a && (0.0..=1.0).contains(&a), "{falloff:?}: {a} {b}");
            }
        }
    }
}
