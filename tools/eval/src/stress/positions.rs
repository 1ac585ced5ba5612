//! Error of packed positions: 5 bits an axis of a cell, 3 or 2 in the narrow packings (paper, section 3.2).

use psao_codec::paper::{Grid, PointFormat};

use super::{Case, StressError};

/// Number of measured points in a grid.
const POINTS: u32 = 50_000;
/// Number of cells along each axis of a grid.
const CELLS: u32 = 64;
/// Half a step of 1/31 of a cell, the codec's own bound, in cells.
const HALF_STEP: f64 = 0.5 / 31.0;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "position-cells",
            what: "Largest error of a point's position on one axis after packing, in cell edges, in a grid at the origin.",
            bound_text: "half a step of 1/31 of a cell and the rounding of f32 (2e-5 of a cell at 64 cells)",
            bound: HALF_STEP + 2e-5,
            documented: None,
            unit: "cells",
            measure: || worst(PointFormat::Bits32, [0.0; 3], 1.0),
        },
        Case {
            name: "position-cells-24",
            what: "The same with 24-bit points, whose positions have 3 bits an axis.",
            bound_text: "half a step of 1/7 of a cell and the rounding of f32",
            bound: 0.5 / 7.0 + 2e-5,
            documented: None,
            unit: "cells",
            measure: || worst(PointFormat::Bits24, [0.0; 3], 1.0),
        },
        Case {
            name: "position-cells-16",
            what: "The same with 16-bit points, whose positions have 2 bits an axis.",
            bound_text: "half a step of 1/3 of a cell and the rounding of f32",
            bound: 0.5 / 3.0 + 2e-5,
            documented: None,
            unit: "cells",
            measure: || worst(PointFormat::Bits16, [0.0; 3], 1.0),
        },
        Case {
            name: "position-scene-1e-3",
            what: "Largest error of a point's position on one axis in a scene one millimetre across.",
            bound_text: "half a step of 1/31 of a cell of 1/64 mm: 0.252 um, and the rounding of f32",
            bound: (HALF_STEP + 2e-5) * 1e-3 / 64.0 * 1e6,
            documented: None,
            unit: "um",
            measure: || Ok(worst(PointFormat::Bits32, [0.0; 3], 1e-3 / 64.0)? * 1e6),
        },
        Case {
            name: "position-scene-1e4",
            what: "Largest error of a point's position on one axis in a scene ten kilometres across.",
            bound_text: "half a step of 1/31 of a cell of 156.25 m: 2.52 m, and the rounding of f32",
            bound: (HALF_STEP + 2e-5) * 1e4 / 64.0,
            documented: None,
            unit: "m",
            measure: || worst(PointFormat::Bits32, [-5e3; 3], 1e4 / 64.0),
        },
        Case {
            name: "position-far-1e4",
            what: "Largest error of a point's position on one axis in a grid of 0.1 m cells that begins ten kilometres from the origin.",
            bound_text: "half a step of 1/31 of a cell: 1.61 mm; documented: plus twice the 0.98 mm between neighbouring f32 values there",
            bound: HALF_STEP * 0.1 * 1e3,
            documented: Some(HALF_STEP * 0.1 * 1e3 + 2.0 * 0.976_562_5),
            unit: "mm",
            measure: || Ok(worst(PointFormat::Bits32, [1e4; 3], 0.1)? * 1e3),
        },
    ]
}

/// Returns the largest error on one axis in metres, over points spread through a grid at `origin` with cells of `edge`.
fn worst(format: PointFormat, origin: [f32; 3], edge: f32) -> Result<f64, StressError> {
    let grid = Grid::new(origin, edge, [CELLS; 3]).map_err(StressError::new)?;
    let mut worst = 0.0_f64;
    for index in 0..POINTS {
        let share = spread(index);
        let point: [f32; 3] =
            std::array::from_fn(|axis| origin[axis] + (share[axis] * f64::from(CELLS)) as f32 * edge);
        let located = grid.locate(point);
        let packed = format.unpack(format.pack(located.frac, [0.0, 0.0, 1.0], 0));
        let corner = grid.corner(located.cell);
        for axis in 0..3 {
            let back = corner[axis] + packed.frac[axis] * edge;
            worst = worst.max((f64::from(back) - f64::from(point[axis])).abs());
        }
    }
    Ok(worst)
}

/// Returns point `index` of the additive recurrence with the generalised golden ratio, in `[0, 1)` on each axis
/// (Roberts 2018). The points are even in space and lie on no lattice that rounding might favour.
fn spread(index: u32) -> [f64; 3] {
    let ratio = 1.220_744_084_605_759_5_f64;
    let step = [1.0 / ratio, 1.0 / (ratio * ratio), 1.0 / (ratio * ratio * ratio)];
    step.map(|step| (0.5 + step * f64::from(index)).fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_the_codecs_own() {
        assert!((f64::from(PointFormat::Bits32.max_position_error()) - HALF_STEP).abs() < 1e-6);
    }

    #[test]
    fn the_worst_case_comes_close_to_its_bound() {
        for format in PointFormat::ALL {
            let found = worst(format, [0.0; 3], 1.0).unwrap();
            let bound = f64::from(format.max_position_error());
            assert!(found > 0.99 * bound && found <= bound + 2e-5, "{format:?}: {found} of {bound}");
        }
    }

    #[test]
    fn points_reach_all_octants() {
        let octant = |p: [f64; 3]| p.iter().fold(0, |bits, &axis| bits * 2 + usize::from(axis >= 0.5));
        let mut seen = [0; 8];
        (0..8_000).for_each(|index| seen[octant(spread(index))] += 1);
        assert!(seen.iter().all(|&n| (950..1050).contains(&n)), "{seen:?}");
    }
}
