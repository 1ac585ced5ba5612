//! The curve that orders the points of a set, by its definition. A cube has eight octants. The curve passes through
//! them in an order in which neighbours follow one another. In each octant the curve is the same, turned and mirrored.

/// An octant: which half it is along x, y and z, and how its own curve lies in it. `axes` has the axes that become x,
/// y and z; `mirrored` tells along which of them the curve is mirrored.
struct Octant {
    halves: [u32; 3],
    axes: [usize; 3],
    mirrored: [bool; 3],
}

const fn octant(halves: [u32; 3], axes: [usize; 3], mirrored: [bool; 3]) -> Octant {
    Octant { halves, axes, mirrored }
}

/// The octants in the order of the curve.
const OCTANTS: [Octant; 8] = [
    octant([0, 0, 0], [2, 0, 1], [false; 3]),
    octant([0, 0, 1], [1, 0, 2], [false; 3]),
    octant([0, 1, 1], [0, 1, 2], [false; 3]),
    octant([0, 1, 0], [2, 1, 0], [true, false, true]),
    octant([1, 1, 0], [2, 1, 0], [false; 3]),
    octant([1, 1, 1], [0, 1, 2], [false; 3]),
    octant([1, 0, 1], [1, 0, 2], [true, true, false]),
    octant([1, 0, 0], [2, 0, 1], [true, true, false]),
];

/// Returns the place of a node in a cube of 2^`levels` nodes along each axis.
pub(super) fn place(node: [u32; 3], levels: u32) -> u64 {
    if levels == 0 {
        return 0;
    }
    let edge = 1 << (levels - 1);
    let halves = node.map(|axis| axis / edge);
    let before = OCTANTS.iter().take_while(|octant| octant.halves != halves).count();
    let Octant { axes, mirrored, .. } = OCTANTS[before];
    let inner: [u32; 3] = std::array::from_fn(|axis| {
        let at = node[axes[axis]] % edge;
        if mirrored[axis] { edge - 1 - at } else { at }
    });
    before as u64 * u64::from(edge).pow(3) + place(inner, levels - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_passes_every_node_once_and_goes_from_neighbour_to_neighbour() {
        let mut nodes: Vec<(u64, [u32; 3])> =
            (0..4096).map(|n| [n % 16, n / 16 % 16, n / 256]).map(|node| (place(node, 4), node)).collect();
        nodes.sort_unstable();
        assert!(nodes.iter().map(|node| node.0).eq(0..4096));
        for pair in nodes.windows(2) {
            let apart: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(apart, 1, "{pair:?}");
        }
    }
}
