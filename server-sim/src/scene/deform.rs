//! Deformed geometry: morph targets, skins and changing scale, all in metric local space.

use glam::{DAffine3, DMat3, Mat3, Vec3, Vec4};

use crate::scene::mesh::{Geometry, Mesh, SkinWeights};

/// A transform from mesh space to the instance's local space: the upper three rows of a matrix, row by row. Each row
/// has four numbers, the last of which is the translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMatrix(pub [f32; 12]);

impl JointMatrix {
    pub(crate) fn new(m: &DAffine3) -> Self {
        let (c, t) = (m.matrix3, m.translation);
        let rows = [
            [c.x_axis.x, c.y_axis.x, c.z_axis.x, t.x],
            [c.x_axis.y, c.y_axis.y, c.z_axis.y, t.y],
            [c.x_axis.z, c.y_axis.z, c.z_axis.z, t.z],
        ];
        let mut out = [0.0; 12];
        out.iter_mut().zip(rows.as_flattened()).for_each(|(slot, v)| *slot = *v as f32);
        Self(out)
    }

    fn point(&self, p: Vec3) -> Vec3 {
        let m = &self.0;
        let row = |r: usize| m[r] * p.x + m[r + 1] * p.y + m[r + 2] * p.z + m[r + 3];
        Vec3::new(row(0), row(4), row(8))
    }

    fn vector(&self, v: Vec3) -> Vec3 {
        let m = &self.0;
        let row = |r: usize| m[r] * v.x + m[r + 1] * v.y + m[r + 2] * v.z;
        Vec3::new(row(0), row(4), row(8))
    }

    /// Returns the normal of a surface after the transform, up to its length and the determinant's sign. The cofactor
    /// matrix keeps normals perpendicular under any scale and shear, even if one axis is flattened.
    fn normal(&self, n: Vec3) -> Vec3 {
        let m = &self.0;
        let [x, y, z] = [0, 4, 8].map(|r| Vec3::new(m[r], m[r + 1], m[r + 2]));
        Vec3::new(y.cross(z).dot(n), z.cross(x).dot(n), x.cross(y).dot(n))
    }

    /// Returns the weighted sum of a vertex's joint matrices.
    fn blend(joints: &[Self], skin: &SkinWeights, vertex: usize) -> Self {
        let groups = vertex * skin.sets..(vertex + 1) * skin.sets;
        let mut sum = [0.0_f32; 12];
        for (numbers, weights) in skin.joints[groups.clone()].iter().zip(&skin.weights[groups]) {
            for (&joint, &weight) in numbers.iter().zip(weights) {
                if weight > 0.0 {
                    sum.iter_mut().zip(&joints[usize::from(joint)].0).for_each(|(s, m)| *s += weight * m);
                }
            }
        }
        Self(sum)
    }
}

/// Returns the vector scaled to unit length, or `fallback` for a vector without length.
fn unit_or(v: Vec3, fallback: Vec3) -> Vec3 {
    let squared = v.length_squared();
    if squared > 1e-36 && squared.is_finite() {
        v / squared.sqrt()
    } else {
        v.try_normalize().unwrap_or(fallback)
    }
}

/// Computes the mesh with its morph targets at `weights`. Normals and tangents have unit length.
pub(crate) fn morph(mesh: &Mesh, weights: &[f32], out: &mut Geometry) {
    out.copy_from(&mesh.base);
    for (target, &weight) in mesh.morphs.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        out.positions.iter_mut().zip(&target.positions).for_each(|(p, d)| *p += *d * weight);
        out.normals.iter_mut().zip(&target.normals).for_each(|(n, d)| *n += *d * weight);
        out.tangents.iter_mut().zip(&target.tangents).for_each(|(t, d)| *t += (*d * weight).extend(0.0));
    }
    for (normal, base) in out.normals.iter_mut().zip(&mesh.base.normals) {
        *normal = unit_or(*normal, *base);
    }
    for (tangent, base) in out.tangents.iter_mut().zip(&mesh.base.tangents) {
        *tangent = unit_or(tangent.truncate(), base.truncate()).extend(base.w);
    }
}

/// Applies a linear map of any kind in place.
pub(crate) fn stretch(linear: Mat3, geometry: &mut Geometry) {
    if linear == Mat3::IDENTITY {
        return;
    }
    let whole = JointMatrix::new(&DAffine3 { matrix3: to_f64(linear), translation: glam::DVec3::ZERO });
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    geometry.positions.iter_mut().for_each(|p| *p = whole.point(*p));
    geometry.normals.iter_mut().for_each(|n| *n = unit_or(whole.normal(*n) * sign, *n));
    for t in &mut geometry.tangents {
        *t = transform_tangent(*t, whole.vector(t.truncate()), sign);
    }
}

/// Returns a tangent after a transform. Mirroring flips the side of the bitangent.
fn transform_tangent(old: Vec4, moved: Vec3, sign: f32) -> Vec4 {
    unit_or(moved, old.truncate()).extend(old.w * sign)
}

/// Moves every vertex by its weighted joint matrices, in place. `mirrored` joints turn surfaces inside out.
pub(crate) fn skin(joints: &[JointMatrix], weights: &SkinWeights, mirrored: bool, geometry: &mut Geometry) {
    let sign = if mirrored { -1.0 } else { 1.0 };
    let vertices = geometry.positions.iter_mut().zip(&mut geometry.normals).enumerate();
    let mut tangents = geometry.tangents.iter_mut();
    for (v, (position, normal)) in vertices {
        let matrix = JointMatrix::blend(joints, weights, v);
        *position = matrix.point(*position);
        *normal = unit_or(matrix.normal(*normal) * sign, *normal);
        if let Some(t) = tangents.next() {
            *t = transform_tangent(*t, matrix.vector(t.truncate()), sign);
        }
    }
}

/// Converts a matrix to double precision.
pub(crate) fn to_f64(m: Mat3) -> DMat3 {
    DMat3::from_cols(m.x_axis.as_dvec3(), m.y_axis.as_dvec3(), m.z_axis.as_dvec3())
}

/// Converts a matrix to single precision.
pub(crate) fn to_f32(m: DMat3) -> Mat3 {
    Mat3::from_cols(m.x_axis.as_vec3(), m.y_axis.as_vec3(), m.z_axis.as_vec3())
}
