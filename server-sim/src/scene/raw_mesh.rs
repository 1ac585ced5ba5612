//! Turns raw primitives into meshes: drops triangles without area and computes missing normals and tangents.

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::scene::ids::MaterialId;
use crate::scene::material::Material;
use crate::scene::mesh::{Geometry, Mesh, MorphTarget, SkinWeights, area_vector};
use crate::scene::report::SceneReport;

/// A primitive as read or modelled. Every list is as long as `positions` or absent. All indices are in range, and all
/// numbers are finite.
#[derive(Debug, Clone, Default)]
pub(crate) struct RawMesh {
    pub(crate) name: String,
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Option<Vec<Vec3>>,
    pub(crate) tangents: Option<Vec<Vec4>>,
    pub(crate) uvs: Option<Vec<Vec2>>,
    pub(crate) normal_uvs: Option<Vec<Vec2>>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) skin: Option<SkinWeights>,
    pub(crate) morphs: Vec<MorphTarget>,
}

impl RawMesh {
    /// Returns the mesh, or `None` if no part of it has a surface. The report counts the reason.
    pub(crate) fn into_mesh(
        mut self,
        id: MaterialId,
        material: &Material,
        report: &mut SceneReport,
    ) -> Option<Mesh> {
        if material.all_masked() {
            report.masked_out_primitives += 1;
            return None;
        }
        self.drop_degenerate(report);
        if self.triangles.is_empty() {
            report.empty_primitives += 1;
            return None;
        }
        if self.normals.is_none() {
            report.flat_normals += 1;
            self.unweld();
            self.flatten_morphs();
        }
        let mut normals = self.normals.take().unwrap_or_default();
        report.replaced_normals += repair_normals(&mut normals, &self.positions, &self.triangles);
        report.opposed_triangles += opposed(&normals, &self.positions, &self.triangles);
        self.skin.iter_mut().for_each(|skin| report.unweighted_vertices += normalise(skin));
        if material.mask.as_ref().is_some_and(|mask| mask.texture.is_some()) && self.uvs.is_none() {
            report.missing_texcoords += 1;
        }
        let tangents = self.finish_tangents(material, &normals, report);
        Some(Mesh {
            name: self.name,
            material: id,
            base: Geometry { positions: self.positions, normals, tangents },
            uvs: self.uvs,
            normal_uvs: self.normal_uvs,
            triangles: self.triangles.into(),
            skin: self.skin,
            morphs: self.morphs,
        })
    }

    /// Drops triangles that are a line or a point at all times.
    fn drop_degenerate(&mut self, report: &mut SceneReport) {
        let moves = self.skin.is_some() || !self.morphs.is_empty();
        let before = self.triangles.len();
        let positions = &self.positions;
        self.triangles.retain(|t| {
            let distinct = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            distinct && (moves || area_vector(positions, *t).length_squared() > 0.0)
        });
        report.degenerate_triangles += before - self.triangles.len();
    }

    /// Gives every triangle its own vertices and its own normal.
    fn unweld(&mut self) {
        let order: Vec<usize> = self.triangles.iter().flatten().map(|&v| v as usize).collect();
        gather(&mut self.positions, &order);
        for uvs in [&mut self.uvs, &mut self.normal_uvs].into_iter().flatten() {
            gather(uvs, &order);
        }
        self.tangents = None; // without normals the file's tangents mean nothing (glTF 2.0, section 3.7.2.1)
        if let Some(skin) = &mut self.skin {
            let groups: Vec<usize> = order.iter().flat_map(|v| v * skin.sets..(v + 1) * skin.sets).collect();
            gather(&mut skin.joints, &groups);
            gather(&mut skin.weights, &groups);
        }
        for morph in &mut self.morphs {
            gather(&mut morph.positions, &order);
            morph.normals.clear();
            morph.tangents.clear();
        }
        self.triangles = (0..self.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        self.normals = Some(vec![Vec3::ZERO; self.positions.len()]);
    }

    /// Stores the change of each flat normal under a full morph as that target's normal displacement.
    fn flatten_morphs(&mut self) {
        let base = vertex_normals(&self.positions, &self.triangles);
        for morph in self.morphs.iter_mut().filter(|morph| !morph.positions.is_empty()) {
            let moved: Vec<Vec3> = self.positions.iter().zip(&morph.positions).map(|(p, d)| p + d).collect();
            let bent = vertex_normals(&moved, &self.triangles);
            morph.normals =
                bent.iter().zip(&base).map(|(b, n)| if *b == Vec3::ZERO { *b } else { b - n }).collect();
        }
    }

    /// Returns the tangents that the normal map requires: the file's, or tangents derived from the texture
    /// coordinates.
    fn finish_tangents(
        &mut self,
        material: &Material,
        normals: &[Vec3],
        report: &mut SceneReport,
    ) -> Vec<Vec4> {
        if material.normal_map.is_some() && self.normal_uvs.is_none() {
            report.missing_texcoords += 1;
        }
        let uvs = match &self.normal_uvs {
            Some(uvs) if material.normal_map.is_some() => uvs,
            _ => {
                self.normal_uvs = None;
                self.morphs.iter_mut().for_each(|morph| morph.tangents.clear());
                return Vec::new();
            }
        };
        match self.tangents.take() {
            Some(tangents) => tangents.iter().zip(normals).map(|(t, n)| orthogonalised(*t, *n)).collect(),
            None => {
                report.generated_tangents += 1;
                self.morphs.iter_mut().for_each(|morph| morph.tangents.clear());
                derive_tangents(&self.positions, normals, uvs, &self.triangles)
            }
        }
    }
}

/// Replaces a list by the elements at `order`.
fn gather<T: Copy>(list: &mut Vec<T>, order: &[usize]) {
    if !list.is_empty() {
        *list = order.iter().map(|&i| list[i]).collect();
    }
}

/// Returns the normalised sum of the area vectors of each vertex's triangles, or zero for a sum without length.
pub(crate) fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for &triangle in triangles {
        let area = area_vector(positions, triangle);
        triangle.iter().for_each(|&v| sums[v as usize] += area);
    }
    sums.iter().map(|sum| sum.try_normalize().unwrap_or(DVec3::ZERO).as_vec3()).collect()
}

/// Scales normals to unit length. The area-weighted normal of its triangles replaces a normal without length; +Y does
/// if that has no length either. Returns the number of replaced normals, or 0 for a mesh that came without any
/// normals.
pub(crate) fn repair_normals(normals: &mut [Vec3], positions: &[Vec3], triangles: &[[u32; 3]]) -> usize {
    let broken = |n: &Vec3| n.length_squared() < 1e-12;
    let all = normals.iter().all(broken);
    let fallback = if normals.iter().any(broken) { vertex_normals(positions, triangles) } else { Vec::new() };
    let mut replaced = 0;
    for (v, normal) in normals.iter_mut().enumerate() {
        if broken(normal) {
            replaced += 1;
            *normal = fallback[v];
        }
        *normal = normal.as_dvec3().try_normalize().unwrap_or(DVec3::Y).as_vec3();
    }
    if all { 0 } else { replaced }
}

/// Returns the number of triangles whose vertex normals all point to the other side of their face.
fn opposed(normals: &[Vec3], positions: &[Vec3], triangles: &[[u32; 3]]) -> usize {
    let against = |triangle: &&[u32; 3]| {
        let face = area_vector(positions, **triangle);
        triangle.iter().all(|&v| normals[v as usize].as_dvec3().dot(face) < 0.0)
    };
    triangles.iter().filter(against).count()
}

/// Makes the weights of each vertex non-negative with a sum of 1. Returns the number of vertices without weights.
fn normalise(skin: &mut SkinWeights) -> usize {
    let mut unweighted = 0;
    for group in skin.weights.chunks_mut(skin.sets) {
        let weights = group.as_flattened_mut();
        weights.iter_mut().for_each(|w| *w = w.max(0.0));
        let sum: f32 = weights.iter().sum();
        if sum > 0.0 && sum.is_finite() {
            // Apart from an exporter's rounding the sum is 1 already: keep those bits.
            if (sum - 1.0).abs() > 1e-6 {
                weights.iter_mut().for_each(|w| *w /= sum);
            }
        } else {
            unweighted += 1;
            weights.fill(0.0);
            weights[0] = 1.0;
        }
    }
    unweighted
}

/// Returns a unit tangent perpendicular to the normal, with a sign of 1 or -1.
fn orthogonalised(tangent: Vec4, normal: Vec3) -> Vec4 {
    let along = tangent.truncate();
    let flat = (along - normal * normal.dot(along)).try_normalize();
    let flat = flat.unwrap_or_else(|| any_tangent(normal));
    flat.extend(if tangent.w < 0.0 { -1.0 } else { 1.0 })
}

/// Returns some direction perpendicular to a unit normal.
pub(crate) fn any_tangent(normal: Vec3) -> Vec3 {
    let axis = if normal.x.abs() < 0.6 { Vec3::X } else { Vec3::Y };
    axis.cross(normal).try_normalize().unwrap_or(Vec3::X)
}

/// Returns the tangents along which the texture's u grows. They are computed per triangle from its edges and summed
/// over the triangles of a vertex. The texture's v grows downwards, so the bitangent (green, up) points against it.
fn derive_tangents(positions: &[Vec3], normals: &[Vec3], uvs: &[Vec2], triangles: &[[u32; 3]]) -> Vec<Vec4> {
    let mut sums = vec![(DVec3::ZERO, DVec3::ZERO); positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| (positions[v as usize].as_dvec3(), uvs[v as usize].as_dvec2()));
        let (e, f) = (b.0 - a.0, c.0 - a.0);
        let (s, t) = (b.1 - a.1, c.1 - a.1);
        let turn = s.perp_dot(t);
        if turn == 0.0 {
            continue;
        }
        let (u, v) = ((e * t.y - f * s.y) / turn, (f * s.x - e * t.x) / turn);
        let weight = e.cross(f).length();
        let unit = |d: DVec3| d.try_normalize().unwrap_or(DVec3::ZERO) * weight;
        for &vertex in triangle {
            let sum = &mut sums[vertex as usize];
            sum.0 += unit(u);
            sum.1 += unit(v);
        }
    }
    let finish = |((u, v), normal): (&(DVec3, DVec3), &Vec3)| {
        let n = normal.as_dvec3();
        let handed = if n.cross(*u).dot(-*v) < 0.0 { -1.0 } else { 1.0 };
        let along = u.try_normalize().unwrap_or(DVec3::ZERO).as_vec3();
        orthogonalised(along.extend(handed), *normal)
    };
    sums.iter().zip(normals).map(finish).collect()
}
