//! Shapes of the built-in scenes: small closed or open surfaces that are transformed and combined.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec2, Vec3};

use crate::scene::mesh::area_vector;
use crate::scene::raw_mesh::{RawMesh, vertex_normals};

/// A surface with normals, texture coordinates and triangles wound counter-clockwise from outside.
#[derive(Debug, Clone, Default)]
pub(super) struct Solid {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
}

impl Solid {
    /// Converts the shape to a raw mesh.
    pub(super) fn raw(self, name: &str) -> RawMesh {
        RawMesh {
            name: name.to_owned(),
            positions: self.positions,
            normals: Some(self.normals),
            uvs: Some(self.uvs),
            triangles: self.triangles,
            ..RawMesh::default()
        }
    }

    /// Returns the positions so far.
    pub(super) fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    fn vertex(&mut self, position: DVec3, normal: DVec3, uv: DVec2) -> u32 {
        self.positions.push(position.as_vec3());
        self.normals.push(normal.as_vec3());
        self.uvs.push(uv.as_vec2());
        self.positions.len() as u32 - 1
    }

    /// Adds a flat polygon with corners counter-clockwise from outside. Texture coordinates cover the first four
    /// corners: lower left, lower right, upper right, upper left.
    pub(super) fn polygon(&mut self, corners: &[DVec3]) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let uvs = [DVec2::Y, DVec2::ONE, DVec2::X, DVec2::ZERO];
        let first = self.positions.len() as u32;
        for (corner, i) in corners.iter().zip(0..) {
            self.vertex(*corner, normal, uvs[i % 4]);
        }
        for i in 1..corners.len() as u32 - 1 {
            self.triangles.push([first, first + i, first + i + 1]);
        }
    }

    /// Adds a flat polygon of a body around `centre`. Its corners may run in either direction.
    fn polygon_around(&mut self, centre: DVec3, mut corners: Vec<DVec3>) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if normal.dot(corners[0] - centre) < 0.0 {
            corners.reverse();
        }
        self.polygon(&corners);
    }

    /// Adds another shape, transformed.
    pub(super) fn add(&mut self, other: &Self, place: DAffine3) -> &mut Self {
        let first = self.positions.len() as u32;
        let normals = place.matrix3.inverse().transpose();
        let mirrored = place.matrix3.determinant() < 0.0;
        for i in 0..other.positions.len() {
            let position = place.transform_point3(other.positions[i].as_dvec3());
            let normal = (normals * other.normals[i].as_dvec3()).normalize_or_zero();
            self.vertex(position, normal, other.uvs[i].as_dvec2());
        }
        let turn = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        self.triangles.extend(other.triangles.iter().map(|t| turn(t).map(|v| v + first)));
        self
    }

    /// Adds another shape, translated.
    pub(super) fn add_at(&mut self, other: &Self, x: f64, y: f64, z: f64) -> &mut Self {
        self.add(other, DAffine3::from_translation(DVec3::new(x, y, z)))
    }

    /// Returns a box around the origin with chamfered edges.
    pub(super) fn block(half: DVec3, bevel: f64) -> Self {
        let mut solid = Self::default();
        let signs = [-1.0, 1.0];
        // The corner, nearest to the box's corner `s`, of the face perpendicular to `axis`.
        let corner = |s: DVec3, axis: usize| {
            let mut inset = DVec3::splat(bevel);
            inset[axis] = 0.0;
            s * (half - inset)
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for sign in signs {
                let at = |a: f64, b: f64| {
                    let mut s = DVec3::splat(sign);
                    (s[u], s[v]) = (a, b);
                    corner(s, axis)
                };
                solid.polygon_around(
                    DVec3::ZERO,
                    vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)],
                );
            }
            if bevel > 0.0 {
                // The four edges along this axis.
                for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    let at = |end: f64, face: usize| {
                        let mut s = DVec3::splat(end);
                        (s[u], s[v]) = (a, b);
                        corner(s, face)
                    };
                    solid.polygon_around(DVec3::ZERO, vec![at(-1.0, u), at(1.0, u), at(1.0, v), at(-1.0, v)]);
                }
            }
        }
        for i in 0..8_u32 {
            let s =
                DVec3::new(signs[(i & 1) as usize], signs[(i >> 1 & 1) as usize], signs[(i >> 2) as usize]);
            if bevel > 0.0 {
                solid.polygon_around(DVec3::ZERO, (0..3).map(|axis| corner(s, axis)).collect());
            }
        }
        solid
    }

    /// Removes the flat faces that point along `direction`. Faces that touch another body are invisible and would
    /// waste points.
    pub(super) fn without_facing(mut self, direction: DVec3) -> Self {
        let positions = &self.positions;
        self.triangles.retain(|t| area_vector(positions, *t).normalize_or_zero().dot(direction) < 0.999);
        self
    }

    /// Returns a bar along x with a symmetric cross-section, given as half widths (z) and heights from bottom to top.
    pub(super) fn bar(half_length: f64, profile: &[(f64, f64)]) -> Self {
        let mut solid = Self::default();
        let point = |x: f64, side: f64, (z, y): (f64, f64)| DVec3::new(x * half_length, y, side * z);
        for pair in profile.windows(2) {
            let [low, high] = [pair[0], pair[1]];
            let [a, b, c, d] = [(-1.0, low), (1.0, low), (1.0, high), (-1.0, high)];
            solid.polygon(&[a, b, c, d].map(|(x, p)| point(x, 1.0, p)));
            solid.polygon(&[b, a, d, c].map(|(x, p)| point(x, -1.0, p)));
            if low.1 == high.1 {
                continue;
            }
            solid.polygon(
                &[(1.0, low), (-1.0, low), (-1.0, high), (1.0, high)].map(|(z, p)| point(1.0, z, p)),
            );
            solid.polygon(
                &[(-1.0, low), (1.0, low), (1.0, high), (-1.0, high)].map(|(z, p)| point(-1.0, z, p)),
            );
        }
        solid
    }

    /// Returns a smooth surface over closed rings of equal length. Seen along the path from the first to the last
    /// ring, the rings run clockwise.
    pub(super) fn loft(rings: &[Vec<DVec3>]) -> Self {
        let mut solid = Self::default();
        let around = rings.first().map_or(0, Vec::len);
        for (i, ring) in rings.iter().enumerate() {
            for (j, p) in ring.iter().enumerate() {
                let uv = DVec2::new(j as f64 / around as f64, i as f64 / rings.len() as f64);
                solid.vertex(*p, DVec3::ZERO, uv);
            }
        }
        for i in 0..rings.len().saturating_sub(1) {
            for j in 0..around {
                let at = |i: usize, j: usize| (i * around + j % around) as u32;
                let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
                solid.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        solid.smoothed()
    }

    /// Replaces the normals by smooth ones: the area-weighted mean of the triangles at each vertex.
    pub(super) fn smoothed(mut self) -> Self {
        self.normals = vertex_normals(&self.positions, &self.triangles);
        self
    }

    /// Returns a body of revolution about y. Each section of the profile (radius, height) is smooth, from bottom to
    /// top on the outside. Sections meet in sharp edges. `shape` returns a factor of the radius for an angle and a
    /// height.
    pub(super) fn turned(sections: &[&[(f64, f64)]], around: usize, shape: impl Fn(f64, f64) -> f64) -> Self {
        let mut solid = Self::default();
        for section in sections {
            let ring = |&(radius, height): &(f64, f64)| {
                let point = |j: usize| {
                    let angle = TAU * j as f64 / around as f64;
                    let r = radius * shape(angle, height);
                    DVec3::new(r * libm::cos(angle), height, -r * libm::sin(angle))
                };
                (0..around).map(point).collect()
            };
            let rings: Vec<Vec<DVec3>> = section.iter().map(ring).collect();
            solid.add(&Self::loft(&rings), DAffine3::IDENTITY);
        }
        solid
    }

    /// Returns a circular body of revolution about y.
    pub(super) fn lathe(sections: &[&[(f64, f64)]], around: usize) -> Self {
        Self::turned(sections, around, |_, _| 1.0)
    }

    /// Returns a round pipe along a path, with closed ends.
    pub(super) fn pipe(path: &[DVec3], radius: f64, around: usize) -> Self {
        let rings = sweep(path, around, |_| (radius, radius));
        let mut solid = Self::loft(&rings);
        let mut first = rings[0].clone();
        first.reverse();
        solid.polygon(&first);
        solid.polygon(&rings[rings.len() - 1]);
        solid
    }

    /// Returns a sphere of 20 * 4^`level` triangles whose radius depends on the direction.
    pub(super) fn ball(level: u32, radius: impl Fn(DVec3) -> f64) -> Self {
        let (mut points, mut triangles) = icosahedron();
        for _ in 0..level {
            let mut middle = std::collections::BTreeMap::new();
            let mut finer = Vec::with_capacity(triangles.len() * 4);
            for [a, b, c] in triangles {
                let mut between = |p: u32, q: u32| {
                    *middle.entry((p.min(q), p.max(q))).or_insert_with(|| {
                        points.push((points[p as usize] + points[q as usize]).normalize());
                        points.len() as u32 - 1
                    })
                };
                let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
                finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            triangles = finer;
        }
        let mut solid = Self { triangles, ..Self::default() };
        for direction in points {
            solid.vertex(direction * radius(direction), direction, DVec2::ZERO);
        }
        solid.smoothed()
    }

    /// Returns a flat one-sided sheet of `columns` by `rows` quads in the xy plane, hanging down from the origin.
    pub(super) fn sheet(width: f64, height: f64, columns: u32, rows: u32) -> Self {
        let mut solid = Self::default();
        for r in 0..=rows {
            for c in 0..=columns {
                let uv = DVec2::new(f64::from(c) / f64::from(columns), f64::from(r) / f64::from(rows));
                solid.vertex(DVec3::new((uv.x - 0.5) * width, -uv.y * height, 0.0), DVec3::Z, uv);
            }
        }
        for r in 0..rows {
            for c in 0..columns {
                let a = r * (columns + 1) + c;
                let (b, below) = (a + 1, a + columns + 1);
                solid.triangles.extend([[a, below, below + 1], [a, below + 1, b]]);
            }
        }
        solid
    }
}

/// Returns closed rings along a path, for [`Solid::loft`]. `radii` returns the half axes at a fraction (0 to 1) of
/// the path.
pub(super) fn sweep(path: &[DVec3], around: usize, radii: impl Fn(f64) -> (f64, f64)) -> Vec<Vec<DVec3>> {
    let last = path.len() - 1;
    let direction = |i: usize| (path[(i + 1).min(last)] - path[i.saturating_sub(1)]).normalize();
    let first = direction(0);
    let mut across = if first.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    let mut rings = Vec::with_capacity(path.len());
    for (i, centre) in path.iter().enumerate() {
        let along = direction(i);
        across = (across - along * along.dot(across)).normalize();
        let (u, v) = (across, along.cross(across));
        let (a, b) = radii(i as f64 / last as f64);
        let point = |j: usize| {
            let angle = TAU * j as f64 / around as f64;
            *centre + u * (a * libm::cos(angle)) + v * (b * libm::sin(angle))
        };
        rings.push((0..around).map(point).collect());
    }
    rings
}

/// Returns the corners and faces of a regular icosahedron of radius 1.
fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let long = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut points = Vec::new();
    for (a, b) in [(-1.0, long), (1.0, long), (-1.0, -long), (1.0, -long)] {
        points.extend(
            [DVec3::new(a, b, 0.0), DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a)].map(DVec3::normalize),
        );
    }
    let mut faces = Vec::new();
    let near = |p: usize, q: usize| points[p].dot(points[q]) > 0.4;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = (points[b] - points[a]).cross(points[c] - points[a]).dot(points[a]) > 0.0;
                    faces.push(if outward {
                        [a as u32, b as u32, c as u32]
                    } else {
                        [a as u32, c as u32, b as u32]
                    });
                }
            }
        }
    }
    (points, faces)
}

/// Returns the rotation about x, y or z (0, 1, 2) by an angle in radians.
pub(super) fn turn(axis: usize, angle: f64) -> DMat3 {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut columns = [DVec3::ZERO; 3];
    columns[axis][axis] = 1.0;
    (columns[u][u], columns[u][v]) = (c, s);
    (columns[v][u], columns[v][v]) = (-s, c);
    DMat3::from_cols(columns[0], columns[1], columns[2])
}

/// Returns a rotation followed by a translation.
pub(super) fn at(turned: DMat3, x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3 { matrix3: turned, translation: DVec3::new(x, y, z) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the volume of a closed surface; positive if its triangles face outwards.
    fn volume(solid: &Solid) -> f64 {
        let corner = |v: u32| solid.positions[v as usize].as_dvec3();
        solid.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
    }

    fn normals_face_out(solid: &Solid) -> bool {
        solid.triangles.iter().all(|&t| {
            let face = area_vector(&solid.positions, t);
            t.iter().all(|&v| face.dot(solid.normals[v as usize].as_dvec3()) >= -1e-9)
        })
    }

    #[test]
    fn closed_shapes_have_their_volume_and_face_outwards() {
        let cylinder = Solid::lathe(
            &[&[(0.0, 0.0), (1.0, 0.0)], &[(1.0, 0.0), (1.0, 2.0)], &[(1.0, 2.0), (0.0, 2.0)]],
            64,
        );
        let pipe = Solid::pipe(&[DVec3::ZERO, DVec3::Z, DVec3::new(0.0, 0.0, 2.0)], 1.0, 64);
        let shapes = [
            (Solid::block(DVec3::new(1.0, 2.0, 3.0), 0.0), 48.0),
            (Solid::block(DVec3::splat(1.0), 0.1), 8.0 - 12.0 * 0.005 * 1.8 - 8.0 * (0.001 - 0.001 / 6.0)),
            (Solid::ball(4, |_| 1.0), 4.19),
            (cylinder, 6.273),
            (pipe, 6.273),
        ];
        for (i, (solid, expected)) in shapes.iter().enumerate() {
            assert!((volume(solid) - expected).abs() < 0.03, "shape {i}: {} not {expected}", volume(solid));
            assert!(normals_face_out(solid), "shape {i}");
        }
    }

    #[test]
    fn moving_and_mirroring_keeps_surfaces_outward() {
        let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 2.0, 1.0));
        let mut whole = Solid::default();
        whole.add(&Solid::ball(3, |_| 1.0), mirrored);
        assert!((volume(&whole) - 2.0 * 4.15).abs() < 0.1);
        assert!(normals_face_out(&whole));
    }
}
