//! Animations of a glTF file.

use std::collections::BTreeMap;
use std::sync::Arc;

use gltf::json::animation::{Animation, Interpolation as JsonInterpolation, Property as JsonProperty};
use gltf::json::validation::Checked;

use super::document::GltfDocument;
use super::{AnimationChoice, ScenePart};
use crate::scene::animation::{Curve, Interpolation, Property};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::model::{AnimationClip, Channel, Model};

/// Adds the animations that the part plays.
pub(super) fn read(
    document: &GltfDocument,
    part: &ScenePart,
    first_node: usize,
    model: &mut Model,
) -> Result<(), SceneError> {
    let all = &document.root.animations;
    let chosen = match &part.play {
        AnimationChoice::All => 0..all.len(),
        AnimationChoice::None => 0..0,
        AnimationChoice::Index(index) if *index < all.len() => *index..*index + 1,
        AnimationChoice::Index(index) => return Err(unknown(document, index.to_string())),
        AnimationChoice::Name(name) => {
            let found = all.iter().position(|animation| animation.name.as_ref() == Some(name));
            let index = found.ok_or_else(|| unknown(document, name.clone()))?;
            index..index + 1
        }
    };
    for index in chosen {
        let clip = model.clips.len();
        let length_s = read_one(document, index, first_node, clip, model)?;
        model.clips.push(AnimationClip { length_s, speed: part.speed, phase_s: part.phase_s });
    }
    Ok(())
}

fn unknown(document: &GltfDocument, requested: String) -> SceneError {
    let name = |(i, animation): (usize, &Animation)| animation.name.clone().unwrap_or_else(|| i.to_string());
    let available = document.root.animations.iter().enumerate().map(name).collect();
    SceneError::UnknownAnimation { path: document.path.clone(), requested, available }
}

/// Adds the channels of one animation. Returns its length: the time of its last key.
fn read_one(
    document: &GltfDocument,
    index: usize,
    first_node: usize,
    clip: usize,
    model: &mut Model,
) -> Result<f64, SceneError> {
    let animation = &document.root.animations[index];
    let mut curves: BTreeMap<(usize, u8, usize), Arc<Curve>> = BTreeMap::new();
    let mut length_s = 0.0_f64;
    for (c, channel) in animation.channels.iter().enumerate() {
        let place = format!("animations[{index}].channels[{c}]");
        let node = document.get("node", channel.target.node, &place)?;
        let Checked::Valid(property) = channel.target.path else {
            return Err(document.error(place, GltfProblem::Invalid("target.path")));
        };
        let (property, width) = match property {
            JsonProperty::Translation => (Property::Translation, 3),
            JsonProperty::Scale => (Property::Scale, 3),
            JsonProperty::Rotation => (Property::Rotation, 4),
            JsonProperty::MorphTargetWeights => {
                let mesh = node.mesh.map(|mesh| document.get("mesh", mesh, &place)).transpose()?;
                let targets = mesh.and_then(|mesh| mesh.primitives.first()).and_then(|p| p.targets.as_ref());
                (Property::Weights, targets.map_or(0, Vec::len))
            }
        };
        if width == 0 {
            model.report.idle_channels += 1;
            continue;
        }
        let key = (channel.sampler.value(), property as u8, width);
        let curve = match curves.get(&key) {
            Some(curve) => Arc::clone(curve),
            None => {
                let curve = Arc::new(read_curve(document, animation, key.0, property, width, &place)?);
                curves.insert(key, Arc::clone(&curve));
                curve
            }
        };
        length_s = length_s.max(curve.end_s());
        model.channels.push(Channel {
            node: first_node + channel.target.node.value(),
            property,
            clip,
            curve,
        });
    }
    Ok(length_s)
}

fn read_curve(
    document: &GltfDocument,
    animation: &Animation,
    sampler: usize,
    property: Property,
    width: usize,
    place: &str,
) -> Result<Curve, SceneError> {
    let count = animation.samplers.len();
    let out_of_range =
        || document.error(place, GltfProblem::OutOfRange { what: "sampler", index: sampler, count });
    let sampler = animation.samplers.get(sampler).ok_or_else(out_of_range)?;
    let interpolation = match sampler.interpolation {
        Checked::Valid(JsonInterpolation::Linear) => Interpolation::Linear,
        Checked::Valid(JsonInterpolation::Step) => Interpolation::Step,
        Checked::Valid(JsonInterpolation::CubicSpline) => Interpolation::Cubic,
        Checked::Invalid => return Err(document.error(place, GltfProblem::Invalid("interpolation"))),
    };
    let times = document.floats::<1>(sampler.input, place)?;
    if let Some(element) = times.windows(2).position(|pair| pair[1] < pair[0]) {
        let here = format!("accessors[{}]", sampler.input.value());
        return Err(document.error(here, GltfProblem::TimeGoesBack { element: element + 1 }));
    }
    let values = match property {
        Property::Weights => document.floats::<1>(sampler.output, place)?.into_flattened(),
        Property::Rotation => document.floats::<4>(sampler.output, place)?.into_flattened(),
        Property::Translation | Property::Scale => {
            document.floats::<3>(sampler.output, place)?.into_flattened()
        }
    };
    super::nodes::check(&values).map_err(|problem| document.error(place, problem))?;
    let parts = if interpolation == Interpolation::Cubic { 3 } else { 1 };
    let expected = times.len() * width * parts;
    if values.len() != expected {
        let what = "numbers of an animation's output";
        return Err(document.error(place, GltfProblem::CountMismatch { what, expected, found: values.len() }));
    }
    let times = times.into_flattened();
    Ok(Curve { interpolation, rotation: property == Property::Rotation, width, times, values })
}
