//! Still scenes from plain triangles, for stress tests and experiments.

use glam::Vec3;

use super::camera::CameraPath;
use super::error::SceneError;
use super::limits;
use super::material::Material;
use super::model::{LocalTransform, Model};
use super::raw_mesh::RawMesh;
use super::{Scene, SceneHeader};

/// Length of the clip in seconds, equal to that of a model without animation.
const DURATION_S: f64 = 10.0;

impl Scene {
    /// Builds a still scene from triangles, corners in metres in world space. Each list becomes one instance,
    /// flat-shaded and one-sided. A still camera sees the whole scene.
    ///
    /// Triangles without area are dropped and counted in [`Scene::report`], and so are lists without a remaining
    /// triangle. The digest covers the name and the corners.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::NoTriangles`] if no triangle has a surface, and [`SceneError::TooFar`] or
    /// [`SceneError::TooMany`] beyond the [`limits`].
    ///
    /// ```
    /// use glam::Vec3;
    /// use psao_server::scene::Scene;
    ///
    /// let scene = Scene::from_triangles("corner", &[vec![[Vec3::ZERO, Vec3::Z, Vec3::X]]], 0.6)?;
    /// assert_eq!(scene.instances().len(), 1);
    /// assert!(Scene::from_triangles("line", &[vec![[Vec3::ZERO, Vec3::Z, Vec3::Z]]], 0.6).is_err());
    /// # Ok::<(), psao_server::scene::SceneError>(())
    /// ```
    pub fn from_triangles(
        name: &str,
        lists: &[Vec<[Vec3; 3]>],
        ao_radius_m: f32,
    ) -> Result<Self, SceneError> {
        let limited = |what, count: usize, limit: usize| {
            let error = || SceneError::TooMany { origin: name.to_owned(), what, count, limit };
            if count > limit { Err(error()) } else { Ok(()) }
        };
        limited("lists", lists.len(), limits::MAX_INSTANCES)?;
        limited("triangles", lists.iter().map(Vec::len).sum(), limits::MAX_TRIANGLES)?;
        let mut model = Model::default();
        let material = model.add_material(Material::default());
        let node = model.add_node(None, LocalTransform::IDENTITY);
        let mut hasher = blake3::Hasher::new();
        hasher.update(name.as_bytes());
        for (index, list) in lists.iter().enumerate() {
            hasher.update(&(list.len() as u64).to_le_bytes());
            for axis in list.iter().flatten().flat_map(Vec3::to_array) {
                hasher.update(&axis.to_le_bytes());
            }
            let raw = RawMesh {
                name: format!("{name} {index}"),
                positions: list.iter().flatten().copied().collect(),
                triangles: (0..list.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
                ..RawMesh::default()
            };
            if let Some(mesh) = model.add_mesh(raw, material) {
                model.add_mesh_node(&format!("{name} {index}"), node, mesh);
            }
        }
        let header = SceneHeader {
            name: name.to_owned(),
            source: name.to_owned(),
            digest: *hasher.finalize().as_bytes(),
            duration_s: DURATION_S,
            ao_radius_m,
            camera: None::<CameraPath>,
        };
        Self::from_model(model, header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Geometry, InstanceId};

    fn triangle(at: f32) -> [Vec3; 3] {
        [Vec3::new(at, 0.0, 0.0), Vec3::new(at, 0.0, 1.0), Vec3::new(at + 1.0, 0.0, 0.0)]
    }

    #[test]
    fn each_list_is_an_instance_and_keeps_its_corners() {
        let flat = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
        let lists = [vec![triangle(0.0), flat], vec![flat], vec![triangle(3.0), triangle(5.0)]];
        let scene = Scene::from_triangles("soup", &lists, 0.25).unwrap();
        assert_eq!(scene.instances().len(), 2, "a list without surface is no instance");
        assert_eq!(scene.report().degenerate_triangles, 2);
        let pose = scene.pose(0.0);
        let mut geometry = Geometry::default();
        scene.local_geometry(InstanceId(1), &pose, &mut geometry);
        let frame = pose.instances()[1].frame();
        let world: Vec<Vec3> = geometry.positions().iter().map(|&local| frame.point(local)).collect();
        assert_eq!(world, lists[2].concat());
        assert!(geometry.normals().iter().all(|&n| n == Vec3::Y));
    }

    #[test]
    fn the_digest_tells_scenes_apart() {
        let digest = |name, lists: &[_]| *Scene::from_triangles(name, lists, 0.6).unwrap().digest();
        let one = digest("a", &[vec![triangle(0.0), triangle(1.0)]]);
        assert_eq!(one, digest("a", &[vec![triangle(0.0), triangle(1.0)]]));
        assert_ne!(one, digest("b", &[vec![triangle(0.0), triangle(1.0)]]));
        assert_ne!(one, digest("a", &[vec![triangle(0.0)], vec![triangle(1.0)]]));
    }

    #[test]
    fn numbers_out_of_range_are_errors() {
        let nan = [Vec3::ZERO, Vec3::Z, Vec3::new(f32::NAN, 0.0, 0.0)];
        assert!(matches!(
            Scene::from_triangles("nan", &[vec![nan]], 0.6),
            Err(SceneError::NoTriangles { .. })
        ));
        let far = [Vec3::ZERO, Vec3::Z, Vec3::X].map(|corner| corner * 3e9);
        assert!(matches!(Scene::from_triangles("far", &[vec![far]], 0.6), Err(SceneError::TooFar { .. })));
        assert!(Scene::from_triangles("none", &[], 0.6).is_err());
    }

    #[test]
    fn a_million_instances_are_refused_before_anything_is_made_of_them() {
        let lists = vec![Vec::new(); 1_000_000];
        let refused = Scene::from_triangles("dust", &lists, 0.6);
        let limit = limits::MAX_INSTANCES;
        assert!(
            matches!(refused, Err(SceneError::TooMany { count: 1_000_000, limit: found, .. }) if found == limit)
        );
    }
}
