//! The features that each instance of a scene requires over a clip: passes, planes and tracks that can otherwise be
//! omitted.

use psao_proto::message::{CameraPose, Needs};
use rayon::prelude::*;

use crate::bvh::Bounds;
use crate::scene::{Geometry, InstanceId, Motion, Scene, ScenePose};
use crate::visibility::{Overlap, Views};

/// A clip of a scene as streamed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip {
    /// Number of frames from the start, at least 1; 0 counts as 1.
    pub frames: u32,
    /// Frames per second, above 0.
    pub fps: f64,
    /// Distance in metres within which geometry affects AO.
    pub reach_m: f32,
    /// Factor of the camera's half-angle tangents. With `None` everything counts as in view.
    pub view_margin: Option<f32>,
}

/// The features that an instance requires over a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstanceNeeds {
    /// Motion of the instance.
    pub motion: Motion,
    /// Skin, morph targets, mask, both sides, normal map.
    pub needs: Needs,
    /// Whether it may come near a moving instance: the bounds of both over the whole clip are within reach of each
    /// other. They may be there at different times, so only `false` is certain for the frames of the clip. The AO of
    /// a static instance that is near no moving one never changes.
    pub near_mover: bool,
    /// Whether some of it may come into the scene camera's widened view. Only `false` is certain for the frames of
    /// the clip.
    pub in_view: bool,
}

/// Returns the features that all instances of a scene require over a clip, in their order. An instance that is hidden
/// in every frame is near nothing and in no view.
///
/// The time is proportional to the deforming vertices times the frames. In the worst case it is also proportional to
/// the instances times the moving instances.
#[must_use]
pub fn needs(scene: &Scene, clip: &Clip) -> Vec<InstanceNeeds> {
    let instances = scene.instances();
    let rests: Vec<Bounds> = scene.rests().par_iter().map(|rest| around(rest.geometry())).collect();
    let (mut swept, mut in_view) = (vec![Bounds::EMPTY; instances.len()], vec![false; instances.len()]);
    let mut pose = ScenePose::default();
    for frame in 0..clip.frames.max(1) {
        let time_s = f64::from(frame) / clip.fps;
        scene.pose_into(time_s, &mut pose);
        let cameras: Vec<CameraPose> = clip.view_margin.map(|_| scene.camera(time_s)).into_iter().collect();
        let views = clip.view_margin.and_then(|margin| Views::new(&cameras, margin));
        swept.par_iter_mut().zip(&mut in_view).enumerate().for_each_init(
            Geometry::default,
            |geometry, (index, (swept, seen))| {
                let bounds = bounds(scene, &pose, index, &rests, geometry);
                *swept = swept.union(bounds);
                let sees = |views: &Views| {
                    let middle = (bounds.min() + bounds.max()) * 0.5;
                    views.overlap(middle, bounds.size().length() * 0.5) != Overlap::Outside
                };
                *seen |= !bounds.is_empty() && views.as_ref().is_none_or(sees);
            },
        );
    }
    let moves = |index: &usize| instances[*index].motion() != Motion::Static;
    let movers: Vec<usize> = (0..instances.len()).filter(moves).collect();
    let of = |(index, instance): (usize, &crate::scene::Instance)| {
        let reach = swept[index].grown(clip.reach_m);
        let near = |&mover: &usize| mover != index && reach.touches(&swept[mover]);
        InstanceNeeds {
            motion: instance.motion(),
            needs: instance.needs(),
            near_mover: !swept[index].is_empty() && movers.iter().any(near),
            in_view: in_view[index],
        }
    };
    instances.par_iter().enumerate().map(of).collect()
}

/// Returns the bounds of an instance in world space; empty for a hidden instance.
fn bounds(
    scene: &Scene,
    pose: &ScenePose,
    index: usize,
    rests: &[Bounds],
    geometry: &mut Geometry,
) -> Bounds {
    let at = &pose.instances()[index];
    if !at.visible() {
        return Bounds::EMPTY;
    }
    let instance = &scene.instances()[index];
    let local = if instance.motion() == Motion::Deforming {
        scene.local_geometry(InstanceId(index as u32), pose, geometry);
        around(geometry)
    } else {
        rests[instance.rest().index()]
    };
    local.transformed(at.frame().matrix(), at.frame().translation)
}

fn around(geometry: &Geometry) -> Bounds {
    Bounds::around(geometry.positions().iter().copied())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::*;
    use crate::world::SceneBvh;

    fn clip() -> Clip {
        Clip { frames: 24, fps: 6.0, reach_m: 0.6, view_margin: Some(1.0) }
    }

    #[test]
    fn what_is_never_in_view_or_near_a_mover_is_so_in_every_frame() {
        let (mut near, mut far, mut out) = (0, 0, 0);
        for name in Scene::builtin_names() {
            let scene = Arc::new(Scene::load(name).unwrap());
            let needs = needs(&scene, &clip());
            for frame in 0..clip().frames {
                let time_s = f64::from(frame) / clip().fps;
                let pose = scene.pose(time_s);
                let views = Views::new(&[scene.camera(time_s)], 1.0).unwrap();
                let world = SceneBvh::new(&scene, &pose);
                let vertices: Vec<Vec<Vec3>> = (0..needs.len())
                    .map(|index| {
                        let id = InstanceId(index as u32);
                        let posed = world.posed(id).unwrap();
                        let at = world.placement(id);
                        posed.geometry.positions().iter().map(|&local| at.point(local)).collect()
                    })
                    .collect();
                for (index, of) in needs.iter().enumerate() {
                    assert_eq!((of.motion, of.needs), {
                        let instance = &scene.instances()[index];
                        (instance.motion(), instance.needs())
                    });
                    let seen = vertices[index].iter().any(|&vertex| views.see(vertex));
                    assert!(of.in_view || !seen, "{name}, {index} at {time_s}");
                    out += usize::from(!of.in_view);
                    far += usize::from(!of.near_mover);
                    near += usize::from(of.near_mover);
                    if of.near_mover || frame % 6 > 0 {
                        continue;
                    }
                    let own = Bounds::around(vertices[index].iter().copied()).grown(clip().reach_m);
                    let movers = (0..needs.len()).filter(|&mover| {
                        mover != index && scene.instances()[mover].motion() != Motion::Static
                    });
                    for mover in movers {
                        let inside = |&vertex: &Vec3| own.distance_squared(vertex) == 0.0;
                        assert!(!vertices[mover].iter().any(inside), "{name}: {index} is near {mover}");
                    }
                }
            }
        }
        assert!(near > 0 && far > 0 && out > 0, "{near} {far} {out}");
    }

    #[test]
    fn without_views_all_that_is_there_is_in_view() {
        let scene = Scene::load("colonnade").unwrap();
        let all = needs(&scene, &Clip { view_margin: None, frames: 1, ..clip() });
        assert!(all.iter().all(|instance| instance.in_view));
    }
}
