//! Error of octahedral normals in 8 bits, or 4 in the 16-bit packing (paper, section 3.2).

use glam::DVec3;
use psao_codec::quant::oct;

use super::Case;

/// Number of measured directions on the spiral.
const DIRECTIONS: u32 = 400_000;

/// The worst directions of the two encoders. A search that climbed from the worst directions of a dense spiral found
/// them. Each is measured with all signs.
const WORST_DIRECTIONS: [DVec3; 3] = [
    DVec3::new(0.577_350_282_656_106_7, 0.577_350_466_676_335_8, 0.577_350_058_236_362_3),
    DVec3::new(0.611_856_24, 0.611_855_89, 0.501_262_71),
    DVec3::new(0.538_126_79, 0.538_126_94, 0.648_721_01),
];

pub(super) fn cases() -> Vec<Case> {
    let case = |name, what, bound_text, bound, documented, measure| Case {
        name,
        what,
        bound_text,
        bound,
        documented,
        unit: "degrees",
        measure,
    };
    vec![
        case(
            "normals-plain",
            "Largest angle between a normal and its 8-bit octahedral code with each axis rounded separately.",
            "the value of the best of four codes, 10.62 degrees; documented for plain rounding: 15.80",
            10.62,
            Some(15.80),
            || Ok(errors(|normal| oct::decode(oct::encode_plain(normal))).0),
        ),
        case(
            "normals-plain-mean",
            "Mean angle between a normal and its 8-bit octahedral code with each axis rounded separately.",
            "the value of the best of four codes, 5.32 degrees; documented for plain rounding: 5.70",
            5.32,
            Some(5.70),
            || Ok(errors(|normal| oct::decode(oct::encode_plain(normal))).1),
        ),
        case(
            "normals-best-of-four",
            "Largest angle between a normal and the best of the four 8-bit octahedral codes around it.",
            "10.62 degrees",
            10.62,
            None,
            || Ok(errors(best_of_four::<4>).0),
        ),
        case(
            "normals-best-of-four-16",
            "Largest angle between a normal and its octahedral code in a 16-bit point, which has codes for the axes only.",
            "54.74 degrees, for a normal between three axes",
            54.74,
            None,
            || Ok(errors(best_of_four::<2>).0),
        ),
        case(
            "normals-best-of-four-mean",
            "Mean angle between a normal and the best of the four 8-bit octahedral codes around it.",
            "5.32 degrees",
            5.32,
            None,
            || Ok(errors(best_of_four::<4>).1),
        ),
    ]
}

/// Returns the decoded normal of the best of the four codes around a normal, with `BITS` bits an axis.
fn best_of_four<const BITS: u32>(normal: [f32; 3]) -> [f32; 3] {
    oct::decode_bits(BITS, oct::encode_bits(BITS, normal))
}

/// Returns the largest angle in degrees over an even spiral of directions and [`WORST_DIRECTIONS`], and the mean over
/// the spiral.
fn errors(code: fn([f32; 3]) -> [f32; 3]) -> (f64, f64) {
    let angle = |direction: DVec3| {
        let decoded = DVec3::from(code(direction.as_vec3().to_array()).map(f64::from));
        // atan2 is precise at small angles, where acos is not.
        libm::atan2(direction.cross(decoded).length(), direction.dot(decoded)).to_degrees()
    };
    let (mut worst, mut sum) = (0.0_f64, 0.0_f64);
    for index in 0..DIRECTIONS {
        let found = angle(spiral(index, DIRECTIONS));
        worst = worst.max(found);
        sum += found;
    }
    for direction in WORST_DIRECTIONS {
        for signs in 0..8 {
            let sign = |bit: u32| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            worst = worst.max(angle(direction * DVec3::new(sign(0), sign(1), sign(2))));
        }
    }
    (worst, sum / f64::from(DIRECTIONS))
}

/// Returns direction `index` of `count` on a golden-angle spiral from pole to pole.
fn spiral(index: u32, count: u32) -> DVec3 {
    let z = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(count);
    let across = (1.0 - z * z).max(0.0).sqrt();
    let turn = f64::from(index) * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    DVec3::new(across * libm::cos(turn), across * libm::sin(turn), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spiral_is_even_and_of_unit_length() {
        let points: Vec<_> = (0..1_000).map(|i| spiral(i, 1_000)).collect();
        assert!(points.iter().all(|p| (p.length() - 1.0).abs() < 1e-12));
        assert!(points.iter().sum::<DVec3>().length() < 2.0, "no side is favoured");
        for (at, p) in points.iter().enumerate() {
            let nearest = points.iter().enumerate().filter(|&(b, _)| b != at).map(|(_, q)| p.distance(*q));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!((0.05..0.15).contains(&nearest), "{nearest}");
        }
    }

    #[test]
    fn figures_are_the_documented_ones() {
        let (worst, mean) = errors(|normal| oct::decode(oct::encode_plain(normal)));
        assert!((worst - 15.793).abs() < 0.002 && (mean - 5.691).abs() < 0.002, "{worst} {mean}");
        let (worst, mean) = errors(best_of_four::<4>);
        assert!((worst - 10.612).abs() < 0.002 && (mean - 5.317).abs() < 0.002, "{worst} {mean}");
    }
}
