//! The measured screen-space methods, each with the settings that its own paper varies.

use psao_server::ao::{AoSettings, Occlusion};

use crate::screen::{
    Blur, Falloff, FarField, FarFieldSettings, Hbao, LineSweep, Mipmap, MipmapSettings, PyramidHbao,
    Scalable, ScreenError, ScreenMethod, ScreenRays, Separation, Ssao, SsaoPlus,
};

/// Returns every method to measure beside a stream with the AO of `ao`, within its radius. Entries of one name are one
/// method with different settings, the cheapest first.
///
/// Far-field obscurance has its slabs at their points in all settings except one. Slabs midway come closer to rays
/// through the depth buffer ([`far_field_methods`]), but not to rays through the scene ([`FarFieldSettings::midway`]).
///
/// Against obscurance, each method has the falloff of its own paper, as its `new` does. Against binary occlusion, all
/// have [`Falloff::Binary`].
///
/// # Errors
///
/// [`ScreenError`] when a method refuses the radius.
pub fn screen_methods(ao: &AoSettings) -> Result<Vec<Box<dyn ScreenMethod>>, ScreenError> {
    let AoSettings { radius, seed, .. } = *ao;
    let falloff = |own: Falloff| match ao.kind {
        Occlusion::Obscurance => own,
        Occlusion::Binary => Falloff::Binary,
    };
    let mut all: Vec<Box<dyn ScreenMethod>> = Vec::new();
    let ssao = Ssao { seed, ..Ssao::new(radius) };
    for (points, doubled) in [(16, false), (16, true), (32, true)] {
        all.push(Box::new(Ssao { points, doubled, ..ssao.clone() }));
    }
    let ssao_plus = SsaoPlus { seed, ..SsaoPlus::new(radius) };
    for points in [8, 16, 64] {
        all.push(Box::new(SsaoPlus { points, ..ssao_plus.clone() }));
    }
    let hbao = Hbao { seed, ..Hbao::new(radius) };
    let hbao = Hbao { falloff: falloff(hbao.falloff.clone()), ..hbao };
    for (directions, steps) in [(4, 4), (8, 10), (16, 16)] {
        all.push(Box::new(Hbao { directions, steps, ..hbao.clone() }));
    }
    let pyramid = PyramidHbao { seed, ..PyramidHbao::new(radius) };
    let pyramid = PyramidHbao { falloff: falloff(pyramid.falloff.clone()), ..pyramid };
    for directions in [4, 8, 16] {
        all.push(Box::new(PyramidHbao { directions, ..pyramid.clone() }));
    }
    let scalable = Scalable::new(radius);
    let scalable = Scalable { falloff: falloff(scalable.falloff.clone()), ..scalable };
    for taps in [9, 24] {
        all.push(Box::new(Scalable { taps, ..scalable.clone() }));
    }
    let sweep = LineSweep::new(radius);
    let sweep = LineSweep { falloff: falloff(sweep.falloff.clone()), ..sweep };
    for directions in [8, 16, 32] {
        all.push(Box::new(LineSweep { directions, ..sweep.clone() }));
    }
    let far = FarFieldSettings { radius, ..FarFieldSettings::default() };
    let far = FarFieldSettings { falloff: falloff(far.falloff.clone()), ..far };
    let mipmap = MipmapSettings { radius, falloff: far.falloff.clone(), ..MipmapSettings::default() };
    for growth in [2.0, 1.5] {
        all.push(Box::new(Mipmap::new(MipmapSettings { growth, ..mipmap.clone() })?));
    }
    let separate = Some(Separation { blur: true });
    all.push(Box::new(FarField::new(FarFieldSettings { sectors: 18, separate, ..far.clone() })?));
    for (sectors, interval) in [(8, 20), (8, 10), (16, 10), (16, 5)] {
        all.push(Box::new(FarField::new(FarFieldSettings { sectors, interval, ..far.clone() })?));
    }
    all.push(Box::new(FarField::new(FarFieldSettings { midway: true, ..far })?));
    let traced = ScreenRays { seed, ..ScreenRays::new(radius) };
    let traced = ScreenRays { falloff: falloff(traced.falloff.clone()), ..traced };
    for rays in [16, 64, 256] {
        all.push(Box::new(ScreenRays { rays, ..traced.clone() }));
    }
    Ok(all)
}

/// Returns far-field obscurance with the settings that its paper shows (Timonen 2013, section 8), and the methods that
/// it is compared with there.
///
/// Slabs stand at their points, midway, and closer together than in the paper. All methods have the radius and the
/// falloff of `reference`.
///
/// # Errors
///
/// [`ScreenError`] when a method refuses them.
pub fn far_field_methods(reference: &ScreenRays) -> Result<Vec<Box<dyn ScreenMethod>>, ScreenError> {
    let ScreenRays { radius, falloff, .. } = reference;
    let (radius, falloff) = (*radius, || falloff.clone());
    let mut all: Vec<Box<dyn ScreenMethod>> = Vec::new();
    let far = |settings| FarField::new(settings).map(Box::new);
    for midway in [false, true] {
        let base = || FarFieldSettings { radius, falloff: falloff(), midway, ..FarFieldSettings::default() };
        for sectors in [8, 16] {
            for interval in [20, 10, 5] {
                all.push(far(FarFieldSettings { sectors, interval, ..base() })?);
            }
        }
        let separate = Some(Separation { blur: true });
        all.push(far(FarFieldSettings { sectors: 18, separate, ..base() })?);
    }
    // Slabs closer and closer together, at their points: the excess brightness vanishes.
    for density in [1, 2, 4, 8] {
        let base = FarFieldSettings { radius, falloff: falloff(), ..FarFieldSettings::default() };
        all.push(far(FarFieldSettings { interval: 2, density, ..base })?);
    }
    let mipmap = MipmapSettings { radius, falloff: falloff(), ..MipmapSettings::default() };
    all.push(Box::new(Mipmap::new(mipmap)?));
    all.push(Box::new(LineSweep { falloff: falloff(), bias: 1e-3, ..LineSweep::new(radius) }));
    Ok(all)
}

/// Returns pyramid HBAO and the methods that its paper compares it with (Astapov et al. 2021, section 4), at one of
/// several radii.
///
/// The smallest of the radii is `smallest_m`. The radius of `ao` is `reach_px` pixels long
/// ([`reach_px`](super::reach_px())).
///
/// * Pyramid HBAO has D = 8 directions, 4 samples a direction on each level, and the fewest levels that reach
///   `reach_px`.
/// * HBAO has D = 8 and S = 10 at the smallest radius; both grow in proportion to the radius (section 3.1). It has no
///   angle bias, because the paper gives none to it (Eq. 5) or to pyramid HBAO.
/// * Scalable AO has as many taps as pyramid HBAO has samples.
///
/// All have the linear falloff and end with the plain Gaussian of that paper, so that they differ only in their
/// samples.
///
/// # Errors
///
/// [`ScreenError`] when a method refuses the radius. HBAO refuses one of more than 32 times the smallest, because it
/// would need too many directions.
pub fn pyramid_methods(
    ao: &AoSettings,
    smallest_m: f32,
    reach_px: f32,
) -> Result<Vec<Box<dyn ScreenMethod>>, ScreenError> {
    let AoSettings { radius, seed, .. } = *ao;
    let falloff = match ao.kind {
        Occlusion::Obscurance => Falloff::Linear,
        Occlusion::Binary => Falloff::Binary,
    };
    let pyramid =
        PyramidHbao { seed, falloff: falloff.clone(), ..PyramidHbao::new(radius) }.reaching(reach_px);
    pyramid.validate()?;
    let blur: Blur = pyramid.blur;
    let grown = |usual: u32| (usual as f32 * radius / smallest_m).round() as u32;
    let hbao = Hbao::new(radius);
    let (directions, steps) = (grown(hbao.directions), grown(hbao.steps));
    let hbao = Hbao { directions, steps, angle_bias_deg: 0.0, seed, falloff: falloff.clone(), blur, ..hbao };
    hbao.validate()?;
    let taps = pyramid.directions * pyramid.samples * (pyramid.levels + 1);
    let scalable = Scalable { falloff, blur, ..Scalable::new(radius) }.spread(taps, reach_px);
    scalable.validate()?;
    Ok(vec![Box::new(pyramid), Box::new(hbao), Box::new(scalable)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_stand_together_by_name_and_no_two_are_the_same() {
        let far = far_field_methods(&ScreenRays::far(3.0, Falloff::Linear)).unwrap();
        let by_kind = [Occlusion::Obscurance, Occlusion::Binary]
            .map(|kind| screen_methods(&AoSettings::default().with_kind(kind)).unwrap());
        for all in by_kind.into_iter().chain([far]) {
            let mut names: Vec<&str> = all.iter().map(|method| method.name()).collect();
            names.dedup();
            let mut labels: Vec<String> = all.iter().map(|method| method.label()).collect();
            labels.sort();
            labels.dedup();
            assert_eq!(labels.len(), all.len(), "labels name the settings that are swept");
            let mut sorted = names.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), names.len(), "{names:?}");
        }
    }

    #[test]
    fn as_the_radius_doubles_hbao_takes_four_times_the_samples_and_the_pyramid_a_level_at_times() {
        let mut found = Vec::new();
        for (radius, reach) in [(0.25, 20.0), (0.5, 40.0), (1.0, 80.0), (2.0, 160.0), (4.0, 320.0)] {
            let methods = pyramid_methods(&AoSettings::default().with_radius(radius), 0.25, reach).unwrap();
            let names: Vec<_> = methods.iter().map(|method| method.name()).collect();
            assert_eq!(names, ["pyramid-hbao", "hbao", "scalable"]);
            let sampling: Vec<_> = methods.iter().map(|method| method.sampling().unwrap()).collect();
            let times = (radius / 0.25) as u32;
            assert_eq!((sampling[1].directions, sampling[1].along), (Some(8 * times), Some(10 * times)));
            assert_eq!(sampling[0].directions, Some(8), "at any radius");
            assert_eq!(sampling[0].per_pixel, sampling[2].per_pixel, "as many in all");
            found.push([sampling[0].levels, sampling[0].per_pixel, sampling[1].per_pixel]);
        }
        let want = [[2, 96, 80], [2, 96, 320], [3, 128, 1_280], [3, 128, 5_120], [4, 160, 20_480]];
        assert_eq!(found, want);
    }

    #[test]
    fn radii_too_far_apart_are_refused() {
        let methods = |radius, smallest| {
            pyramid_methods(&AoSettings::default().with_radius(radius), smallest, 100.0).map(|_| ())
        };
        assert_eq!(methods(8.0, 0.25), Ok(()));
        let refused = methods(8.2, 0.25).unwrap_err();
        assert!(
            matches!(refused, ScreenError::Setting { method: "hbao", setting: "directions", .. }),
            "{refused}"
        );
        assert_eq!(methods(0.0, 0.25), Err(ScreenError::Radius { radius: 0.0 }));
    }

    #[test]
    fn a_radius_that_is_none_is_refused() {
        assert!(screen_methods(&AoSettings::default().with_radius(f32::NAN)).is_err());
    }
}
