//! Animations of a glTF file.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::document::GltfDocument;
use super::nodes::{FileNodes, check};
use super::schema::{Animation, Channel as JsonChannel, Node};
use super::{AnimationChoice, ScenePart, pointer};
use crate::scene::animation::{Curve, Interpolation, Property};
use crate::scene::error::{GltfProblem, SceneError};
use crate::scene::limits;
use crate::scene::model::{AnimationClip, Channel, Model};
use crate::scene::report::SceneReport;

/// Adds the animations that the part plays.
pub(super) fn read(
    document: &GltfDocument,
    part: &ScenePart,
    nodes: &FileNodes,
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
        let length_s = read_one(document, index, nodes, clip, model)?;
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
    nodes: &FileNodes,
    clip: usize,
    model: &mut Model,
) -> Result<f64, SceneError> {
    let animation = &document.root.animations[index];
    let mut curves: BTreeMap<(usize, u8, usize), Arc<Curve>> = BTreeMap::new();
    let mut length_s = 0.0_f64;
    for (c, channel) in animation.channels.iter().enumerate() {
        let place = format!("animations[{index}].channels[{c}]");
        let Some(target) = target_of(document, channel, nodes, &place, &mut model.report)? else { continue };
        let key = (channel.sampler, target.property as u8, target.width);
        let curve = match curves.get(&key) {
            Some(curve) => Arc::clone(curve),
            None => {
                let curve = Arc::new(read_curve(document, animation, channel.sampler, &target, &place)?);
                curves.insert(key, Arc::clone(&curve));
                curve
            }
        };
        if curve.times.is_empty() {
            model.report.empty_channels += 1;
            continue;
        }
        length_s = length_s.max(curve.end_s());
        let ChannelTarget { property, first, .. } = target;
        let count = model.channels.len() + target.nodes.len();
        if count > limits::MAX_CHANNELS {
            let (count, limit) = (count as u64, limits::MAX_CHANNELS as u64);
            return Err(document.error(place, GltfProblem::TooMany { what: "channels", count, limit }));
        }
        for node in target.nodes {
            model.channels.push(Channel { node, property, first, clip, curve: Arc::clone(&curve) });
        }
    }
    Ok(length_s)
}

/// Target of a channel in the model.
struct ChannelTarget {
    property: Property,
    /// Numbers of one key.
    width: usize,
    /// The first of the property's numbers that the channel drives.
    first: usize,
    nodes: Vec<usize>,
}

/// Returns what a channel drives. Returns `None`, and counts the reason, if that moves no surface.
fn target_of(
    document: &GltfDocument,
    channel: &JsonChannel,
    nodes: &FileNodes,
    place: &str,
    report: &mut SceneReport,
) -> Result<Option<ChannelTarget>, SceneError> {
    let (node, property) = match (&channel.target.extensions.pointer, channel.target.path.as_str()) {
        (Some(pointer), "pointer") => match pointer::parse(&pointer.pointer) {
            Some(pointer::Target::Node { node, property }) => (Some(node), property),
            Some(pointer::Target::NodeWeight { node, weight }) => {
                let count = morph_count(document, node, place)?;
                return Ok(weights(nodes.placements(node), count, Some(weight), report));
            }
            Some(pointer::Target::MeshWeights { mesh, weight }) => {
                return mesh_weights(document, nodes, mesh, weight, place, report);
            }
            None => {
                report.other_channels += 1;
                return Ok(None);
            }
        },
        (_, "translation") => (channel.target.node, Property::Translation),
        (_, "rotation") => (channel.target.node, Property::Rotation),
        (_, "scale") => (channel.target.node, Property::Scale),
        (_, "weights") => (channel.target.node, Property::Weights),
        _ => {
            report.other_channels += 1;
            return Ok(None);
        }
    };
    // To be ignored: an extension may give the target that a reader does not know (glTF 2.0, section 3.11).
    let Some(node) = node else {
        report.channels_without_node += 1;
        return Ok(None);
    };
    document.get("node", &document.root.nodes, node, place)?;
    let width = match property {
        Property::Weights => {
            let count = morph_count(document, node, place)?;
            return Ok(weights(nodes.placements(node), count, None, report));
        }
        Property::Translation | Property::Scale => 3,
        Property::Rotation => 4,
        Property::Visibility => 1,
    };
    Ok(Some(ChannelTarget { property, width, first: 0, nodes: vec![nodes.model(node)] }))
}

/// Returns the channel's target for all morph weights or for one of them.
fn weights(
    nodes: Vec<usize>,
    count: usize,
    one: Option<usize>,
    report: &mut SceneReport,
) -> Option<ChannelTarget> {
    let width = if one.is_some() { 1 } else { count };
    let first = one.unwrap_or(0);
    if first >= count || nodes.is_empty() {
        report.idle_channels += 1;
        return None;
    }
    Some(ChannelTarget { property: Property::Weights, width, first, nodes })
}

/// Returns the target for the default weights of a mesh: every node that shows it without weights of its own.
fn mesh_weights(
    document: &GltfDocument,
    nodes: &FileNodes,
    mesh: usize,
    one: Option<usize>,
    place: &str,
    report: &mut SceneReport,
) -> Result<Option<ChannelTarget>, SceneError> {
    document.get("mesh", &document.root.meshes, mesh, place)?;
    let follows = |node: &Node| node.mesh == Some(mesh) && node.weights.as_ref().is_none_or(Vec::is_empty);
    let all = document.root.nodes.iter().enumerate().filter(|(_, node)| follows(node));
    let placed: Vec<usize> = all.flat_map(|(i, _)| nodes.placements(i)).collect();
    Ok(weights(placed, targets_of(document, mesh), one, report))
}

fn morph_count(document: &GltfDocument, node: usize, place: &str) -> Result<usize, SceneError> {
    let node = document.get("node", &document.root.nodes, node, place)?;
    let Some(mesh) = node.mesh else { return Ok(0) };
    document.get("mesh", &document.root.meshes, mesh, place)?;
    Ok(targets_of(document, mesh))
}

fn targets_of(document: &GltfDocument, mesh: usize) -> usize {
    let primitives = document.root.meshes[mesh].primitives.iter();
    primitives.map(|primitive| primitive.targets.len()).max().unwrap_or(0)
}

fn read_curve(
    document: &GltfDocument,
    animation: &Animation,
    sampler: usize,
    target: &ChannelTarget,
    place: &str,
) -> Result<Curve, SceneError> {
    let (property, width) = (target.property, target.width);
    let sampler = document.get("sampler", &animation.samplers, sampler, place)?;
    let interpolation = match sampler.interpolation.as_deref().unwrap_or("LINEAR") {
        _ if property == Property::Visibility => Interpolation::Step,
        "LINEAR" => Interpolation::Linear,
        "STEP" => Interpolation::Step,
        "CUBICSPLINE" => Interpolation::Cubic,
        _ => return Err(document.error(place, GltfProblem::Invalid("interpolation"))),
    };
    let times = document.floats::<1>(sampler.input, place)?;
    if let Some(element) = times.windows(2).position(|pair| pair[1] < pair[0]) {
        let here = format!("accessors[{}]", sampler.input);
        return Err(document.error(here, GltfProblem::TimeGoesBack { element: element + 1 }));
    }
    let output = sampler.output;
    let values = match property {
        Property::Weights | Property::Visibility => document.floats::<1>(output, place)?.into_flattened(),
        Property::Rotation => document.floats::<4>(output, place)?.into_flattened(),
        Property::Translation | Property::Scale => document.floats::<3>(output, place)?.into_flattened(),
    };
    check(&values).map_err(|problem| document.error(place, problem))?;
    let parts = if interpolation == Interpolation::Cubic { 3 } else { 1 };
    let expected = times.len() * width * parts;
    if values.len() != expected {
        let what = "numbers of an animation's output";
        return Err(document.error(place, GltfProblem::CountMismatch { what, expected, found: values.len() }));
    }
    let times = times.into_flattened();
    Ok(Curve { interpolation, rotation: property == Property::Rotation, width, times, values })
}
