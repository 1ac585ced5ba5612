//! Pairs of triangles.

use std::collections::BTreeMap;

use psao_server::scene::Geometry;

/// A triangle and, if possible, a neighbour that shares an edge with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TrianglePair {
    /// The first triangle.
    pub(super) first: PairTriangle,
    /// The second triangle; `None` for a single triangle.
    pub(super) second: Option<PairTriangle>,
}

/// One of the triangles of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PairTriangle {
    pub(super) triangle: u32,
    /// The corner opposite the shared edge, 0 to 2.
    pub(super) apex: u8,
}

/// Pairs the triangles of a mesh.
///
/// The longest edges come first, so that the triangles of a rectangle share its diagonal. Triangles that meet at an
/// angle or have different normals along the edge do not pair, because AO need not be smooth across that edge.
pub(super) fn pairs(geometry: &Geometry, triangles: &[[u32; 3]]) -> Vec<TrianglePair> {
    let welded = welded(geometry);
    let corner = |triangle: usize, corner: u8| welded[triangles[triangle][usize::from(corner) % 3] as usize];
    let position = |vertex: u32| geometry.positions()[vertex as usize];
    // Edges by their corners in the order of the first triangle. The second triangle has them in the other order.
    let mut open: BTreeMap<(u32, u32), PairTriangle> = BTreeMap::new();
    let mut shared: Vec<(f32, PairTriangle, PairTriangle)> = Vec::new();
    for triangle in 0..triangles.len() {
        for apex in 0..3 {
            let (from, to) = (corner(triangle, apex + 1), corner(triangle, apex + 2));
            let half = PairTriangle { triangle: triangle as u32, apex };
            match open.remove(&(to, from)) {
                Some(other) => {
                    let length = (position(from) - position(to)).length();
                    shared.push((length, other, half));
                }
                None => {
                    open.insert((from, to), half);
                }
            }
        }
    }
    shared.sort_by(|a, b| {
        b.0.total_cmp(&a.0).then_with(|| (a.1.triangle, a.2.triangle).cmp(&(b.1.triangle, b.2.triangle)))
    });
    let facing = |half: PairTriangle| {
        let [a, b, c] = triangles[half.triangle as usize].map(position);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let mut free = vec![true; triangles.len()];
    let mut pairs = Vec::with_capacity(triangles.len().div_ceil(2));
    for (_, first, second) in shared {
        let both = [first, second].map(|half| half.triangle as usize);
        let flat = facing(first).dot(facing(second)) > MIN_FACING_COSINE;
        if flat && both[0] != both[1] && both.iter().all(|&triangle| free[triangle]) {
            for triangle in both {
                free[triangle] = false;
            }
            pairs.push(TrianglePair { first, second: Some(second) });
        }
    }
    let single = |(triangle, _): (usize, _)| {
        let first =
            PairTriangle { triangle: triangle as u32, apex: longest_edge(triangles[triangle].map(position)) };
        TrianglePair { first, second: None }
    };
    pairs.extend(free.into_iter().enumerate().filter(|&(_, free)| free).map(single));
    pairs
}

/// Cosine of the largest angle between the triangles of a pair, 60 degrees.
const MIN_FACING_COSINE: f32 = 0.5;

/// Returns the corner opposite the longest edge.
fn longest_edge(corners: [glam::Vec3; 3]) -> u8 {
    let length = |apex: usize| (corners[(apex + 1) % 3] - corners[(apex + 2) % 3]).length_squared();
    (0..3_u8).max_by(|&a, &b| length(a.into()).total_cmp(&length(b.into()))).unwrap_or(0)
}

/// Returns for each vertex the first vertex with the same position and normal.
fn welded(geometry: &Geometry) -> Vec<u32> {
    let mut known: BTreeMap<[u32; 6], u32> = BTreeMap::new();
    let both = geometry.positions().iter().zip(geometry.normals());
    (0..)
        .zip(both)
        .map(|(vertex, (position, normal))| {
            // Adding 0 turns -0 into 0.
            let bits = [position.x, position.y, position.z, normal.x, normal.y, normal.z]
                .map(|axis| (axis + 0.0).to_bits());
            *known.entry(bits).or_insert(vertex)
        })
        .collect()
}
