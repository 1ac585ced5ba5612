//! The space-filling curve that orders the points of a set. Neighbours on it are mostly neighbours on the surface.

/// Number of bits of an axis that the curve can tell apart.
pub(crate) const AXIS_BITS: u32 = 21;

/// Returns the place of a lattice node, each coordinate below 2^21, on the three-dimensional Hilbert curve. It uses
/// the transposed form of J. Skilling, "Programming the Hilbert curve", AIP Conference Proceedings 707, 2004.
pub(crate) fn place(coord: [u32; 3]) -> u64 {
    let [mut x, mut y, mut z] = coord;
    let mut bit = 1 << (AXIS_BITS - 1);
    while bit > 1 {
        let below = bit - 1;
        // Undo the turns of each level: invert the low bits of x, or swap them with those of the axis.
        if x & bit != 0 {
            x ^= below;
        }
        for axis in [&mut y, &mut z] {
            if *axis & bit != 0 {
                x ^= below;
            } else {
                let differ = (x ^ *axis) & below;
                x ^= differ;
                *axis ^= differ;
            }
        }
        bit >>= 1;
    }
    y ^= x;
    z ^= y;
    // Gray decoding: every set bit of z inverts all lower bits.
    let mut turned = 0;
    let mut bit = 1 << (AXIS_BITS - 1);
    while bit > 1 {
        if z & bit != 0 {
            turned ^= bit - 1;
        }
        bit >>= 1;
    }
    spread(x ^ turned) << 2 | spread(y ^ turned) << 1 | spread(z ^ turned)
}

/// Returns the low 21 bits with two zeros before each.
fn spread(value: u32) -> u64 {
    let value = u64::from(value) & 0x1F_FFFF;
    let value = (value | value << 32) & 0x001F_0000_0000_FFFF;
    let value = (value | value << 16) & 0x001F_0000_FF00_00FF;
    let value = (value | value << 8) & 0x100F_00F0_0F00_F00F;
    let value = (value | value << 4) & 0x10C3_0C30_C30C_30C3;
    (value | value << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn steps_along_the_curve_are_steps_to_a_neighbour() {
        // The corner cube of 8 x 8 x 8 nodes is one connected stretch of the curve.
        let mut nodes: Vec<(u64, [u32; 3])> =
            (0..512).map(|n| [n & 7, n >> 3 & 7, n >> 6]).map(|node| (place(node), node)).collect();
        nodes.sort_unstable();
        for pair in nodes.windows(2) {
            assert_eq!(pair[1].0 - pair[0].0, 1);
            let distance: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(distance, 1, "{pair:?}");
        }
    }

    proptest! {
        #[test]
        fn different_nodes_have_different_places(
            a in prop::array::uniform3(0_u32..1 << AXIS_BITS), b in prop::array::uniform3(0_u32..1 << AXIS_BITS),
        ) {
            prop_assert_eq!(a == b, place(a) == place(b));
            prop_assert!(place(a) < 1 << (3 * AXIS_BITS));
        }
    }
}
