//! Charts of a mesh: the parts over which AO is smooth.
//!
//! AO jumps at a crease and across a thin sheet, so a value of one side says nothing about the other. A chart is a set of
//! triangles connected over edges that bend by at most 30 degrees. A client blends only points of a place's own chart.
//! Server and client derive the charts from the mesh at rest with the same arithmetic, so both get the same numbers.

/// Square of the cosine of the largest bend between triangles of a chart, 30 degrees, as a fraction.
const BEND_COSINE_SQUARED: [f64; 2] = [3.0, 4.0];

/// The charts of a mesh.
///
/// ```
/// use psao_codec::surface::Charts;
///
/// // Two walls that meet at a right angle, and a floor piece in the plane of the first.
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0]];
/// let charts = Charts::of_mesh(&positions, &[[0, 1, 2], [0, 2, 3], [0, 4, 1]]);
/// assert_eq!([0, 1, 2].map(|triangle| charts.front(triangle)), [0, 1, 0]);
/// assert_eq!(charts.back(0), 2, "backs come after all fronts");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Charts {
    of_triangle: Vec<u32>,
    fronts: u32,
}

impl Charts {
    /// Derives the charts of a mesh at rest. `positions` are in metres, `triangles` have indices of positions,
    /// counter-clockwise from the front.
    ///
    /// Vertices at equal positions count as one. Triangles are joined over an edge that they run through in opposite
    /// directions, if it bends by at most 30 degrees. A triangle without an area, or with an index out of range, is a
    /// chart of its own. Charts are numbered in the order of their first triangles. `docs/spec/codec.md`, "Charts of a
    /// mesh", has the arithmetic.
    #[must_use]
    pub fn of_mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Charts {
        let welded = weld(positions);
        let normals: Vec<[f64; 3]> = triangles.iter().map(|corners| normal(positions, *corners)).collect();
        let mut groups = Groups::new(triangles.len());
        // Triangles by the directed edges that they run through.
        let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * triangles.len());
        for ((corners, normal), triangle) in triangles.iter().zip(&normals).zip(0..) {
            if square(normal) > 0.0 {
                let [a, b, c] = corners.map(|corner| welded[corner as usize]);
                edges.extend([(a, b, triangle), (b, c, triangle), (c, a, triangle)]);
            }
        }
        edges.sort_unstable();
        for &(from, to, triangle) in &edges {
            let first = edges.partition_point(|edge| (edge.0, edge.1) < (to, from));
            let opposite = edges[first..].iter().take_while(|edge| (edge.0, edge.1) == (to, from));
            for &(_, _, other) in opposite {
                if other > triangle && is_smooth(&normals[triangle as usize], &normals[other as usize]) {
                    groups.join(triangle, other);
                }
            }
        }
        groups.numbered()
    }

    /// Returns the number of charts of one side.
    #[must_use]
    pub fn fronts(&self) -> u32 {
        self.fronts
    }

    /// Returns the number of charts: those of the front, and those of the back if the mesh has two sides.
    #[must_use]
    pub fn count(&self, double_sided: bool) -> u32 {
        if double_sided { self.fronts.saturating_mul(2) } else { self.fronts }
    }

    /// Returns the chart of a triangle's front; 0 if there is no such triangle.
    #[inline]
    #[must_use]
    pub fn front(&self, triangle: u32) -> u32 {
        self.of_triangle.get(triangle as usize).copied().unwrap_or(0)
    }

    /// Returns the chart of the back of a triangle of a double-sided mesh.
    #[inline]
    #[must_use]
    pub fn back(&self, triangle: u32) -> u32 {
        self.fronts.saturating_add(self.front(triangle))
    }

    /// Returns the charts of all fronts, one for each triangle.
    #[must_use]
    pub fn of_fronts(&self) -> &[u32] {
        &self.of_triangle
    }
}

/// Returns for each vertex the first one at the same position.
fn weld(positions: &[[f32; 3]]) -> Vec<u32> {
    // Adding 0 turns -0 into 0.
    let bits = |position: &[f32; 3]| position.map(|axis| (axis + 0.0).to_bits());
    let mut order: Vec<([u32; 3], u32)> = positions.iter().map(bits).zip(0..).collect();
    order.sort_unstable();
    let mut welded = vec![0; positions.len()];
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        run.iter().for_each(|(_, vertex)| welded[*vertex as usize] = run[0].1);
    }
    welded
}

/// Returns the normal of a triangle, not of unit length; zero if it has none.
fn normal(positions: &[[f32; 3]], corners: [u32; 3]) -> [f64; 3] {
    let [Some(a), Some(b), Some(c)] = corners.map(|corner| positions.get(corner as usize)) else {
        return [0.0; 3];
    };
    let from_a =
        |to: &[f32; 3]| -> [f64; 3] { std::array::from_fn(|axis| f64::from(to[axis]) - f64::from(a[axis])) };
    let (e, f) = (from_a(b), from_a(c));
    let normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    if square(&normal).is_finite() { normal } else { [0.0; 3] }
}

fn square(a: &[f64; 3]) -> f64 {
    dot(a, a)
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns whether an edge between triangles of these normals bends by at most 30 degrees. It takes no root and no
/// division, so that every machine agrees.
fn is_smooth(a: &[f64; 3], b: &[f64; 3]) -> bool {
    let [numerator, denominator] = BEND_COSINE_SQUARED;
    let along = dot(a, b);
    along > 0.0 && denominator * along * along >= numerator * (square(a) * square(b))
}

/// Disjoint sets of triangles.
struct Groups {
    parent: Vec<u32>,
}

impl Groups {
    fn new(count: usize) -> Groups {
        Groups { parent: (0..count as u32).collect() }
    }

    /// Returns the first triangle of a group. It halves the path to it.
    fn first(&mut self, mut triangle: u32) -> u32 {
        while self.parent[triangle as usize] != triangle {
            let above = self.parent[self.parent[triangle as usize] as usize];
            self.parent[triangle as usize] = above;
            triangle = above;
        }
        triangle
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.first(a), self.first(b));
        // The smaller index stays on top.
        self.parent[a.max(b) as usize] = a.min(b);
    }

    fn numbered(mut self) -> Charts {
        let mut of_triangle: Vec<u32> = Vec::with_capacity(self.parent.len());
        let mut fronts = 0;
        for triangle in 0..self.parent.len() as u32 {
            let first = self.first(triangle);
            let chart = if first == triangle {
                fronts += 1;
                fronts - 1
            } else {
                of_triangle[first as usize]
            };
            of_triangle.push(chart);
        }
        Charts { of_triangle, fronts }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Joins triangles until nothing changes: all pairs, all shared edges.
    fn naive(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u32> {
        let at = |vertex: u32| positions[vertex as usize].map(|axis| axis + 0.0);
        let edges = |t: [u32; 3]| [(at(t[0]), at(t[1])), (at(t[1]), at(t[2])), (at(t[2]), at(t[0]))];
        let mut label: Vec<usize> = (0..triangles.len()).collect();
        let mut changed = true;
        while std::mem::take(&mut changed) {
            for a in 0..triangles.len() {
                for b in 0..triangles.len() {
                    let (m, n) = (normal(positions, triangles[a]), normal(positions, triangles[b]));
                    let angle = dot(&m, &n) / (square(&m).sqrt() * square(&n).sqrt());
                    let meet =
                        edges(triangles[a]).iter().any(|(p, q)| edges(triangles[b]).contains(&(*q, *p)));
                    if a != b
                        && meet
                        && angle >= (30.0_f64).to_radians().cos() - 1e-12
                        && label[a] != label[b]
                    {
                        let low = label[a].min(label[b]);
                        (label[a], label[b], changed) = (low, low, true);
                    }
                }
            }
        }
        let mut order: Vec<usize> = label.clone();
        order.sort_unstable();
        order.dedup();
        label.iter().map(|own| order.iter().position(|other| other == own).unwrap() as u32).collect()
    }

    /// A strip of `count` quads of unit width that bends by `degrees` at every joint, without shared vertices.
    fn strip(count: usize, degrees: f64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut profile = vec![[0.0_f64, 0.0]];
        for joint in 0..count {
            let [x, y] = profile[joint];
            let angle = (degrees * joint as f64).to_radians();
            profile.push([x + angle.cos(), y + angle.sin()]);
        }
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for pair in profile.windows(2) {
            let first = positions.len() as u32;
            for (end, z) in [(0, 0.0), (1, 0.0), (1, 1.0), (0, 1.0)] {
                positions.push([pair[end][0] as f32, pair[end][1] as f32, z]);
            }
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        (positions, triangles)
    }

    #[test]
    fn strips_break_where_they_bend_by_more_than_thirty_degrees() {
        for (degrees, charts) in [(0.0, 1), (29.9, 1), (30.1, 4), (90.0, 4), (179.0, 4)] {
            let (positions, triangles) = strip(4, degrees);
            let found = Charts::of_mesh(&positions, &triangles);
            assert_eq!(found.fronts(), charts, "{degrees} degrees");
            assert_eq!(found.count(true), 2 * charts);
            assert_eq!(found.of_fronts(), naive(&positions, &triangles));
        }
    }

    #[test]
    fn broken_meshes_have_charts_too() {
        let positions =
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f32::NAN; 3], [-0.0, 0.0, -1e30], [1e38; 3]];
        let triangles = [[0, 1, 2], [0, 0, 1], [0, 1, 9], [2, 1, 3], [0, 2, 1], [4, 5, 0], [0, 1, 2]];
        let found = Charts::of_mesh(&positions, &triangles);
        assert_eq!(found.of_fronts().len(), triangles.len());
        assert_eq!(found.fronts(), 7, "the last one runs through its edges like the first: not joined");
        assert_eq!(Charts::of_mesh(&[], &[]), Charts::default());
        assert_eq!((found.front(99), found.back(99)), (0, 7));
    }

    #[test]
    fn three_sheets_at_one_edge_are_joined_where_they_are_smooth() {
        // The third sheet stands upright on the edge between the first two.
        let positions = [[0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let found = Charts::of_mesh(&positions, &[[0, 1, 2], [1, 0, 3], [1, 0, 4]]);
        assert_eq!(found.of_fronts(), [0, 0, 1]);
    }

    proptest! {
        #[test]
        fn charts_are_those_of_all_pairs(
            coordinates in prop::collection::vec(prop::array::uniform3(0_i8..3), 4..12),
            picks in prop::collection::vec(prop::array::uniform3(0_usize..12), 1..24),
        ) {
            let positions: Vec<[f32; 3]> = coordinates.iter().map(|at| at.map(f32::from)).collect();
            let triangles: Vec<[u32; 3]> =
                picks.iter().map(|corners| corners.map(|corner| (corner % positions.len()) as u32)).collect();
            let found = Charts::of_mesh(&positions, &triangles);
            prop_assert_eq!(found.of_fronts(), naive(&positions, &triangles));
        }
    }
}
