//! The hash of Eq. 1 in a table with a power of two of buckets, and its ids in 32 bits (paper, section 3.2).

use std::collections::BTreeSet;

use psao_codec::paper::{ENTRIES_PER_BUCKET, bucket_of, cell_id};

use super::{Case, StressError};

/// Dimensions of a grid whose ids wrap: the product with the factor 31 of Eq. 1 exceeds 2^32.
const WRAPPING_GRID: [u32; 3] = [260, 260, 2050];

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "eq1-plane-256",
            what: "Cells of a wall x = const in a 256 x 256 x 256 grid that find no slot in the paper's table hashed by Eq. 1.",
            bound_text: "at most 1 % lost; documented for Eq. 1 with 32,768 buckets: 98.44 %",
            bound: 1.0,
            documented: Some(98.44),
            unit: "%",
            measure: || Ok(lost([256; 3], 1, eq1)),
        },
        Case {
            name: "eq1-plane-256-double",
            what: "The same wall in a table twice as large.",
            bound_text: "at most 1 % lost; documented for Eq. 1 with 65,536 buckets: 96.88 %",
            bound: 1.0,
            documented: Some(96.88),
            unit: "%",
            measure: || Ok(lost([256; 3], 2, eq1)),
        },
        Case {
            name: "eq1-plane-512x16x512",
            what: "Cells of a wall x = const in a 512 x 16 x 512 grid that find no slot in the paper's table hashed by Eq. 1.",
            bound_text: "at most 1 % lost; documented for Eq. 1 with 4,096 buckets: 99.22 %",
            bound: 1.0,
            documented: Some(99.22),
            unit: "%",
            measure: || Ok(lost([512, 16, 512], 1, eq1)),
        },
        Case {
            name: "mixed-plane-256",
            what: "The wall in the 256 x 256 x 256 grid again, hashed by a mixing function instead of Eq. 1.",
            bound_text: "at most 0.1 % lost: the loss by chance at two cells a bucket of eight",
            bound: 0.1,
            documented: None,
            unit: "%",
            measure: || Ok(lost([256; 3], 1, mixed)),
        },
        Case {
            name: "mixed-plane-512x16x512",
            what: "The wall in the 512 x 16 x 512 grid again, hashed by a mixing function instead of Eq. 1.",
            bound_text: "at most 0.1 % lost: the loss by chance at two cells a bucket of eight",
            bound: 0.1,
            documented: None,
            unit: "%",
            measure: || Ok(lost([512, 16, 512], 1, mixed)),
        },
        Case {
            name: "eq1-id-wraps",
            what: "Pairs of cells that share a 32-bit raw id in a grid of 260 x 260 x 2050 cells, so that a look-up may find the wrong one.",
            bound_text: "no pair; documented: 3,840 pairs between the first and the last layer, (4,0,0) and (0,245,2049) among them",
            bound: 0.0,
            documented: Some(3_840.0),
            unit: "pairs",
            measure: shared_ids,
        },
    ]
}

/// Returns the percentage of the cells of the wall x = dims[0] / 2 that find no entry in `scale` times the paper's
/// table.
fn lost(dims: [u32; 3], scale: u32, hash: fn([u32; 3], [u32; 3]) -> u32) -> f64 {
    let cells = dims[1] * dims[2];
    // 4 entries a cell over 8 entries a bucket, rounded up to a power of two (paper, section 3.2).
    let buckets = (cells * 4).div_ceil(ENTRIES_PER_BUCKET as u32).next_power_of_two() * scale;
    let mut wanted = vec![0_usize; buckets as usize];
    for y in 0..dims[1] {
        for z in 0..dims[2] {
            wanted[bucket_of(hash([dims[0] / 2, y, z], dims), buckets) as usize] += 1;
        }
    }
    let stored: usize = wanted.iter().map(|&cells| cells.min(ENTRIES_PER_BUCKET)).sum();
    100.0 * (1.0 - stored as f64 / f64::from(cells))
}

fn eq1(cell: [u32; 3], dims: [u32; 3]) -> u32 {
    cell_id(cell, dims)
}

/// Hashes a dense index by the finaliser of `SplitMix64` (Steele et al. 2014). Every bit of the index affects every bit
/// of the result.
fn mixed(cell: [u32; 3], dims: [u32; 3]) -> u32 {
    let [x, y, z] = cell.map(u64::from);
    let [dx, dy, _] = dims.map(u64::from);
    let mut h = (x + dx * (y + dy * z)).wrapping_add(0x9E37_79B9_7F4A_7C15);
    h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (h ^ (h >> 31)) as u32
}

/// Counts the pairs of cells that share an id. Only ids of the last layer wrap, and only into those of the first layer.
fn shared_ids() -> Result<f64, StressError> {
    let layer = |z: u32| {
        let rows = 0..WRAPPING_GRID[1];
        rows.flat_map(move |y| (0..WRAPPING_GRID[0]).map(move |x| cell_id([x, y, z], WRAPPING_GRID)))
    };
    let first: BTreeSet<u32> = layer(0).collect();
    Ok(layer(WRAPPING_GRID[2] - 1).filter(|id| first.contains(id)).count() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documented_pair_shares_an_id() {
        assert_eq!(cell_id([4, 0, 0], WRAPPING_GRID), cell_id([0, 245, 2049], WRAPPING_GRID));
        assert_eq!(
            u64::from(cell_id([259, 259, 2048], WRAPPING_GRID)),
            259 + 259 * 260 * 17 + 2048 * 260 * 260 * 31
        );
        assert!(shared_ids().unwrap() > 0.0);
    }

    #[test]
    fn figures_are_the_documented_ones() {
        // y steps by 4,352 and z by a multiple of 65,536: 128 of 32,768 buckets, 8 cells each, of 65,536.
        assert_eq!(lost([256; 3], 1, eq1), 100.0 * (1.0 - 1024.0 / 65536.0));
        assert_eq!(lost([256; 3], 2, eq1), 100.0 * (1.0 - 2048.0 / 65536.0));
        assert_eq!(lost([512, 16, 512], 1, eq1), 100.0 * (1.0 - 64.0 / 8192.0));
    }

    #[test]
    fn a_small_grid_loses_nothing_to_either_hash() {
        assert_eq!(lost([5, 4, 2], 1, eq1), 0.0);
        assert_eq!(lost([5, 4, 2], 1, mixed), 0.0);
    }
}
