//! Scenes that are built in code, without files. They have the same bits on every machine.

mod asteroids;
mod colonnade;
mod model_builder;
mod noise;
mod robot_lab;
mod solid;
mod walker;

use crate::scene::camera::CameraPath;
use crate::scene::error::SceneError;
use crate::scene::model::Model;
use crate::scene::report::SceneReport;
use crate::scene::{Scene, SceneHeader};

/// Names of the built-in scenes.
pub(crate) const NAMES: &[&str] = &["colonnade", "robot-lab", "asteroids"];

/// Version of the built-in scenes. It increases with every change, and so the digests change, too.
const VERSION: u32 = 1;

/// Model and settings of a built-in scene.
pub(super) struct BuiltinScene {
    pub(super) model: Model,
    pub(super) ao_radius_m: f32,
    pub(super) camera: CameraPath,
}

/// Length of every built-in clip in seconds, equal to that of the paper's camera paths (section 4).
pub(super) const DURATION_S: f64 = 15.0;

/// Builds the built-in scene with this name, if there is one.
pub(crate) fn build(name: &str) -> Option<Result<Scene, SceneError>> {
    let mut built = match name {
        "colonnade" => colonnade::build(),
        "robot-lab" => robot_lab::build(),
        "asteroids" => asteroids::build(),
        _ => return None,
    };
    // The triangles without area at the poles of its solids are no loss that anybody would look for in a file.
    built.model.report = SceneReport::default();
    let digest = blake3::hash(format!("psao built-in scene {name} version {VERSION}").as_bytes());
    let header = SceneHeader {
        name: name.to_owned(),
        source: name.to_owned(),
        digest: *digest.as_bytes(),
        duration_s: DURATION_S,
        ao_radius_m: built.ao_radius_m,
        camera: Some(built.camera),
    };
    Some(Scene::from_model(built.model, header))
}
