//! Scene files: TOML, version 1. A scene file places one or more glTF files and gives the camera's path. Unknown keys
//! are errors. Every error names the file and the key.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3, Vec3};
use psao_proto::message::CameraPose;
use serde::Deserialize;

use crate::scene::animation::unit_quaternion;
use crate::scene::camera::{CameraKey, CameraPath};
use crate::scene::error::SceneError;
use crate::scene::gltf::{AnimationChoice, ScenePart};
use crate::scene::io::{Checker, hash_file, read_file};
use crate::scene::limits;
use crate::scene::model::{LocalTransform, Model};
use crate::scene::{Scene, SceneHeader};

/// Default AO radius in metres: the paper's (section 4).
pub(crate) const DEFAULT_RADIUS_M: f32 = 0.6;
/// Length of a clip without animation, seconds.
const STILL_DURATION_S: f64 = 10.0;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    scene: SceneTable,
    part: Vec<PartTable>,
    camera: Option<CameraTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneTable {
    name: String,
    duration_s: f64,
    ao_radius_m: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PartTable {
    file: String,
    animation: Option<AnimationSelector>,
    #[serde(default)]
    translation: [f64; 3],
    rotation: Option<[f64; 4]>,
    scale: Option<ScaleValue>,
    speed: Option<f64>,
    #[serde(default)]
    phase_s: f64,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected \"all\", \"none\", the name of an animation, or its index")]
enum AnimationSelector {
    Index(usize),
    Name(String),
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "expected a number or [x, y, z]")]
enum ScaleValue {
    Uniform(f64),
    Axes([f64; 3]),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    fov_y_deg: f64,
    key: Vec<KeyTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyTable {
    time_s: f64,
    eye: [f64; 3],
    target: [f64; 3],
    up: Option<[f64; 3]>,
}

/// Loads a scene file.
pub(crate) fn load(path: &Path, source: &str) -> Result<Scene, SceneError> {
    let bytes = read_file(path)?;
    let message = |message: String| SceneError::SceneFile { path: path.to_owned(), message };
    let text = std::str::from_utf8(&bytes).map_err(|error| message(format!("not UTF-8: {error}")))?;
    let file: SceneFile = toml::from_str(text).map_err(|error| message(error.to_string()))?;
    let check = Checker { path };
    if file.part.is_empty() {
        return Err(check.wrong("part", "at least one is needed"));
    }
    if file.part.len() > limits::MAX_PARTS {
        return Err(check.wrong(
            "part",
            format!("{} parts, at most {} are supported", file.part.len(), limits::MAX_PARTS),
        ));
    }
    let mut hasher = blake3::Hasher::new();
    hash_file(&mut hasher, &bytes);
    let mut model = Model::default();
    for (i, table) in file.part.iter().enumerate() {
        let part = part_of(&check, table, i)?;
        crate::scene::gltf::load(&part, &mut model, &mut hasher)?;
    }
    let radius = file.scene.ao_radius_m.unwrap_or(f64::from(DEFAULT_RADIUS_M));
    let header = SceneHeader {
        name: file.scene.name,
        source: source.to_owned(),
        digest: *hasher.finalize().as_bytes(),
        duration_s: check.range("scene.duration_s", file.scene.duration_s, 1e-3, 1e6)?,
        ao_radius_m: check.range("scene.ao_radius_m", radius, 1e-4, 1e6)? as f32,
        camera: file.camera.map(|table| camera_of(&check, &table)).transpose()?,
    };
    Scene::from_model(model, header)
}

/// Loads one glTF file as a scene.
pub(crate) fn load_model(path: &Path, source: &str) -> Result<Scene, SceneError> {
    let mut hasher = blake3::Hasher::new();
    let mut model = Model::default();
    let part = ScenePart {
        path: path.to_owned(),
        play: AnimationChoice::All,
        root: LocalTransform::IDENTITY,
        speed: 1.0,
        phase_s: 0.0,
    };
    crate::scene::gltf::load(&part, &mut model, &mut hasher)?;
    let longest = model.clips.iter().map(|clip| clip.length_s).fold(0.0, f64::max);
    let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let header = SceneHeader {
        name,
        source: source.to_owned(),
        digest: *hasher.finalize().as_bytes(),
        duration_s: if longest > 0.0 { longest } else { STILL_DURATION_S },
        ao_radius_m: DEFAULT_RADIUS_M,
        camera: None,
    };
    Scene::from_model(model, header)
}

fn part_of(check: &Checker<'_>, table: &PartTable, index: usize) -> Result<ScenePart, SceneError> {
    let key = |name: &str| format!("part[{index}].{name}");
    let scale = match table.scale {
        None => [1.0; 3],
        Some(ScaleValue::Uniform(s)) => [s; 3],
        Some(ScaleValue::Axes(axes)) => axes,
    };
    let scale = check.vector(&key("scale"), scale)?;
    if scale.min_element() == 0.0 && scale.max_element() == 0.0 {
        return Err(check.wrong(&key("scale"), "it scales the part to nothing"));
    }
    let rotation = DQuat::from_array(table.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    if !(0.5..2.0).contains(&length) {
        return Err(check
            .wrong(&key("rotation"), format!("a unit quaternion is needed, this one has length {length}")));
    }
    Ok(ScenePart {
        path: check
            .path
            .parent()
            .map_or_else(|| PathBuf::from(&table.file), |folder| folder.join(&table.file)),
        play: match &table.animation {
            None => AnimationChoice::All,
            Some(AnimationSelector::Index(index)) => AnimationChoice::Index(*index),
            Some(AnimationSelector::Name(name)) if name == "all" => AnimationChoice::All,
            Some(AnimationSelector::Name(name)) if name == "none" => AnimationChoice::None,
            Some(AnimationSelector::Name(name)) => AnimationChoice::Name(name.clone()),
        },
        root: LocalTransform::Trs {
            translation: check.vector(&key("translation"), table.translation)?,
            rotation: unit_quaternion(rotation),
            scale,
        },
        speed: check.range(&key("speed"), table.speed.unwrap_or(1.0), -1e3, 1e3)?,
        phase_s: check.range(&key("phase_s"), table.phase_s, -1e6, 1e6)?,
    })
}

fn camera_of(check: &Checker<'_>, table: &CameraTable) -> Result<CameraPath, SceneError> {
    if table.key.is_empty() {
        return Err(check.wrong("camera.key", "at least one is needed"));
    }
    let mut keys: Vec<CameraKey> = Vec::new();
    for (i, key) in table.key.iter().enumerate() {
        let name = |field: &str| format!("camera.key[{i}].{field}");
        let vector = |field: &str, value| check.vector(&name(field), value).map(|v: DVec3| v.as_vec3());
        let (eye, target) = (vector("eye", key.eye)?, vector("target", key.target)?);
        let up = match key.up {
            Some(up) => vector("up", up)?,
            None => CameraPose::usual_up(eye.to_array(), target.to_array()).into(),
        };
        let time_s = check.range(&name("time_s"), key.time_s, -1e6, 1e6)?;
        if keys.last().is_some_and(|last| last.time_s >= time_s) {
            return Err(check.wrong(&name("time_s"), "it is not later than the key before it"));
        }
        if (target - eye).cross(up) == Vec3::ZERO {
            return Err(
                check.wrong(&name("up"), "eye, target and up are on one line: choose another up direction")
            );
        }
        keys.push(CameraKey { time_s, eye, target, up });
    }
    Ok(CameraPath::new(check.range("camera.fov_y_deg", table.fov_y_deg, 1.0, 170.0)? as f32, keys))
}
