//! The server's world as a client sees it: the geometry, which both sides share.

use glam::Vec3;
use psao_reconstruct::{AtRest, Surface, Surfaces};
use psao_server::world::{Hit, SceneBvh, SurfaceAt};

/// A scene into which rays can be traced.
pub trait RayScene: Sync {
    /// Returns the distance in metres to the nearest surface from `origin` in the unit direction `direction`, below
    /// `tmax`; `None` when there is none. Back faces count.
    fn distance(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<f32>;

    /// Returns whether a surface is nearer than `tmax` metres.
    fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        self.distance(origin, direction, tmax).is_some()
    }
}

/// A scene at one moment, for views ([`Surfaces`]) and for tracing references ([`RayScene`]).
///
/// Views follow glTF 2.0 (section 3.9.2, double sided): the backs of one-sided materials are not drawn. References
/// count them, as the server's rays do.
#[derive(Clone, Copy, Debug)]
pub struct SceneView<'a> {
    world: &'a SceneBvh,
}

/// Largest number of backs of one-sided faces that a ray passes before it counts as a miss.
const MAX_BACK_FACES: u32 = 256;

impl<'a> SceneView<'a> {
    /// Makes a view of `world` in its current pose.
    pub fn new(world: &'a SceneBvh) -> Self {
        Self { world }
    }

    pub(crate) fn world(&self) -> &'a SceneBvh {
        self.world
    }
}

/// The first drawn surface along a ray.
pub(crate) struct FrontHit {
    /// The hit; its `t` counts from behind the last passed face.
    pub(crate) hit: Hit,
    /// The surface of the triangle's front at the hit.
    pub(crate) at: SurfaceAt,
    /// Whether the ray meets its back.
    pub(crate) back: bool,
    /// Distance from the ray's origin in metres.
    pub(crate) t: f32,
}

impl SceneView<'_> {
    /// Returns the nearest surface along a ray, without the backs of one-sided faces.
    pub(crate) fn front_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<FrontHit> {
        let scene = self.world.scene();
        let mut from = 0.0_f32;
        for _ in 0..MAX_BACK_FACES {
            let hit = self.world.closest(origin + dir * from, dir, tmax - from)?;
            let at = self.world.surface(&hit)?;
            let t = from + hit.t;
            let mesh = &scene.meshes()[scene.instances()[hit.instance.index()].mesh().index()];
            let back = at.facing.dot(dir) > 0.0;
            if !back || scene.material(mesh).double_sided() {
                return Some(FrontHit { hit, at, back, t });
            }
            // The ray continues a few units in the last place behind the face.
            let magnitude = at.position.abs().max_element().max(t);
            from = t + (magnitude * 4.0 * f32::EPSILON).max(f32::MIN_POSITIVE);
        }
        None
    }
}

impl Surfaces for SceneView<'_> {
    fn first_hit(&self, origin: Vec3, dir: Vec3, tmax: f32) -> Option<Surface> {
        let FrontHit { hit, at, back, t } = self.front_hit(origin, dir, tmax)?;
        let turned = |normal: Vec3| if back { -normal } else { normal };
        let rest = self.world.rest_surface(&hit);
        let charts = self.world.scene().rest(&self.world.scene().instances()[hit.instance.index()]).charts();
        let chart = if back { charts.back(hit.triangle) } else { charts.front(hit.triangle) };
        Some(Surface {
            t,
            position: at.position,
            normal: turned(at.normal),
            instance: hit.instance.0,
            rest: rest.map(|rest| AtRest { position: rest.position, normal: turned(rest.normal), chart }),
        })
    }
}

impl RayScene for SceneView<'_> {
    fn distance(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<f32> {
        self.world.closest(origin, direction, tmax).map(|hit| hit.t)
    }

    fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        self.world.occluded(origin, direction, tmax)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use psao_proto::message::CameraPose;
    use psao_reconstruct::{Camera, GBuffer, Size, cast_view};
    use psao_server::scene::{InstanceId, Motion, Scene};

    use super::*;
    use crate::shapes;

    fn world(lists: &[Vec<[Vec3; 3]>]) -> SceneBvh {
        let scene = Arc::new(Scene::from_triangles("test", lists, 0.6).unwrap());
        let pose = scene.pose(0.0);
        SceneBvh::new(&scene, &pose)
    }

    #[test]
    fn the_nearest_front_is_seen_with_its_instance_and_normal() {
        let world = world(&[shapes::floor(4.0), shapes::cube(Vec3::new(0.0, 1.0, 0.0), 0.5)]);
        let view = SceneView::new(&world);
        let down = view.first_hit(Vec3::new(0.1, 5.0, 0.2), Vec3::NEG_Y, f32::INFINITY).unwrap();
        assert_eq!((down.instance, down.normal), (1, Vec3::Y));
        assert!((down.t - 3.5).abs() < 1e-5 && (down.position - Vec3::new(0.1, 1.5, 0.2)).length() < 1e-5);
        let beside = view.first_hit(Vec3::new(2.0, 5.0, 0.0), Vec3::NEG_Y, f32::INFINITY).unwrap();
        assert_eq!((beside.instance, beside.normal), (0, Vec3::Y));
        assert_eq!(view.first_hit(Vec3::new(2.0, 5.0, 0.0), Vec3::NEG_Y, 4.9), None, "beyond tmax");
        assert_eq!(view.first_hit(Vec3::new(2.0, 5.0, 0.0), Vec3::Y, f32::INFINITY), None);
    }

    #[test]
    fn backs_of_one_sided_faces_are_looked_through_but_occlude() {
        let world = world(&[shapes::floor(4.0), shapes::cube(Vec3::new(0.0, 1.0, 0.0), 0.5)]);
        let view = SceneView::new(&world);
        let inside = Vec3::new(0.1, 1.0, 0.2);
        let seen = view.first_hit(inside, Vec3::NEG_Y, f32::INFINITY).unwrap();
        assert_eq!(seen.instance, 0, "out of the cube, to the floor");
        assert!((seen.t - 1.0).abs() < 1e-5, "{seen:?}");
        assert!((view.distance(inside, Vec3::NEG_Y, 10.0).unwrap() - 0.5).abs() < 1e-5);
        assert!(view.occluded(inside, Vec3::X, 1.0) && !view.occluded(inside, Vec3::X, 0.3));
    }

    /// Returns the view of the scene's camera at `time_s`.
    fn seen(world: &SceneBvh, time_s: f64) -> GBuffer {
        let camera = world.scene().camera(time_s);
        cast_view(&SceneView::new(world), &camera, Size::new(160, 90).unwrap()).unwrap()
    }

    #[test]
    fn at_rest_what_does_not_deform_is_where_it_is_in_its_own_space() {
        let mut checked = [0, 0];
        for name in ["colonnade", "robot-lab"] {
            let scene = Arc::new(Scene::load(name).unwrap());
            let world = SceneBvh::new(&scene, &scene.pose(1.3));
            let view = seen(&world, 1.3);
            for fragment in (0..view.size().pixels()).filter_map(|pixel| view.fragment(pixel)) {
                let motion = scene.instances()[fragment.instance as usize].motion();
                if motion == Motion::Deforming {
                    continue;
                }
                checked[usize::from(motion == Motion::Rigid)] += 1;
                let at = world.placement(InstanceId(fragment.instance));
                let rest = fragment.rest.unwrap();
                assert!((rest.position - at.local_point(fragment.position)).length() < 1e-4, "{fragment:?}");
                assert!((rest.normal - at.local_direction(fragment.normal)).length() < 1e-4, "{fragment:?}");
            }
        }
        assert!(checked[0] > 1000 && checked[1] > 100, "{checked:?}");
    }

    #[test]
    fn at_rest_a_walker_stands_still() {
        let scene = Arc::new(Scene::load("colonnade").unwrap());
        let mut world = SceneBvh::new(&scene, &scene.pose(0.7));
        let view = SceneView::new(&world);
        let camera = Camera::new(&scene.camera(0.7)).unwrap();
        let size = Size::new(160, 90).unwrap();
        let rays = (0..90).flat_map(|y| (0..160).map(move |x| (x, y)));
        let seen = rays.filter_map(|(x, y)| {
            let ray = camera.ray(size, x, y);
            let hit = world.closest(ray.origin, ray.direction, f32::INFINITY)?;
            let instance = &scene.instances()[hit.instance.index()];
            if instance.motion() != Motion::Deforming {
                return None;
            }
            let rest = view.first_hit(ray.origin, ray.direction, f32::INFINITY)?.rest.unwrap();
            // The place lies on the hit triangle at rest.
            let mesh = scene.rest(instance);
            let [a, b, c] =
                mesh.triangles()[hit.triangle as usize].map(|v| mesh.geometry().positions()[v as usize]);
            let area = |a: Vec3, b: Vec3, c: Vec3| (b - a).cross(c - a).length();
            let parts = area(rest.position, b, c) + area(a, rest.position, c) + area(a, b, rest.position);
            assert!(parts <= area(a, b, c) * 1.001 + 1e-7, "{rest:?} is not in {:?}", [a, b, c]);
            assert!((rest.normal.length() - 1.0).abs() < 1e-4);
            Some((hit, rest, world.surface(&hit)?.position))
        });
        let seen: Vec<_> = seen.collect();
        assert!(seen.len() > 30, "{} pixels show walkers", seen.len());
        world.update(&scene.pose(1.1));
        let moved = |(hit, _, before): &&(_, _, Vec3)| {
            (world.surface(hit).unwrap().position - *before).length() > 0.01
        };
        assert!(seen.iter().filter(moved).count() * 2 > seen.len(), "they walk, but for feet on the floor");
        for (hit, rest, _) in seen {
            let still = world.rest_surface(&hit).unwrap();
            assert_eq!(still.position, rest.position);
            assert!(still.normal == rest.normal || still.normal == -rest.normal);
        }
    }

    #[test]
    fn a_picture_of_a_cube_shows_its_silhouette() {
        let world = world(&[shapes::cube(Vec3::ZERO, 1.0)]);
        let pose = CameraPose {
            eye: [0.0, 0.0, 5.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 2.0 * libm::atanf(0.5).to_degrees(),
            aspect: 1.0,
        };
        let view = cast_view(&SceneView::new(&world), &pose, Size::new(64, 64).unwrap()).unwrap();
        // The front face is 4 m away and 2 m wide. It fills half of a view that is 4 m wide there.
        assert_eq!(view.covered(), 32 * 32);
        assert!((0..view.size().pixels()).filter_map(|p| view.fragment(p)).all(|f| f.normal == Vec3::Z));
    }
}
