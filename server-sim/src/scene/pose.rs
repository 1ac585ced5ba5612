//! A scene at a given time: the frames of all instances and the geometry of deforming ones.

use glam::{DAffine3, DMat3, DVec3};

use crate::scene::Scene;
use crate::scene::deform::{self, JointMatrix, to_f32};
use crate::scene::hierarchy::NodeHierarchy;
use crate::scene::ids::InstanceId;
use crate::scene::instance::{Deformation, Deformer, Instance, InstancePose, ScenePose};
use crate::scene::mesh::Geometry;
use crate::scene::rigid::{RigidFrame, columns, rotation_of};

impl Scene {
    /// Returns the scene at a given time in seconds. Animations loop with their own lengths; any finite time is
    /// allowed. Equal times give equal bits, whatever the order of calls.
    #[must_use]
    pub fn pose(&self, time_s: f64) -> ScenePose {
        let mut pose = ScenePose::default();
        self.pose_into(time_s, &mut pose);
        pose
    }

    /// Does the same as [`Scene::pose`], but reuses the memory of `pose`.
    pub fn pose_into(&self, time_s: f64, pose: &mut ScenePose) {
        pose.time_s = time_s;
        self.hierarchy.evaluate(time_s, &mut pose.worlds);
        pose.instances.resize_with(self.instances.len(), || InstancePose {
            frame: RigidFrame::IDENTITY,
            deformation: Deformation::Rest,
            visible: true,
        });
        for (instance, slot) in self.instances.iter().zip(&mut pose.instances) {
            place(&self.hierarchy, instance, time_s, &pose.worlds, slot);
        }
    }

    /// Writes positions, normals and tangents of an instance in its local space, metres, into `out`. For an instance
    /// that does not deform this copies its rest; [`RestMesh::geometry`](crate::scene::RestMesh::geometry) avoids the
    /// copy. `out` becomes empty if the scene lacks the instance or the pose belongs to another scene.
    pub fn local_geometry(&self, instance: InstanceId, pose: &ScenePose, out: &mut Geometry) {
        let found = self.instances.get(instance.index()).zip(pose.instances.get(instance.index()));
        let Some((instance, at)) = found else {
            out.copy_from(&Geometry::default());
            return;
        };
        let mesh = &self.meshes[instance.mesh.index()];
        match &at.deformation {
            Deformation::Rest => out.copy_from(&self.rests[instance.rest.index()].geometry),
            Deformation::Affine(linear) => {
                out.copy_from(&mesh.base);
                deform::stretch(*linear, out);
            }
            Deformation::Morph { weights, linear } => {
                deform::morph(mesh, weights, out);
                deform::stretch(*linear, out);
            }
            Deformation::Skin { joints, weights } => {
                if weights.is_empty() {
                    out.copy_from(&mesh.base);
                } else {
                    deform::morph(mesh, weights, out);
                }
                if let (Some(skin), Deformer::Skin { mirrored, .. }) = (&mesh.skin, &instance.deformer) {
                    deform::skin(joints, skin, *mirrored, out);
                }
            }
        }
    }
}

/// Returns the rigid part of a world transform. A transform that is scaled to nothing keeps only its translation.
pub(crate) fn frame_of(world: &DAffine3) -> RigidFrame {
    RigidFrame::new(rotation_of(world.matrix3).unwrap_or(DMat3::IDENTITY), world.translation)
}

/// Returns the linear part of a world transform relative to the frame; it acts on the local geometry.
pub(crate) fn linear_in(frame: &RigidFrame, world: &DAffine3) -> DMat3 {
    frame.inverse().matrix3 * world.matrix3
}

/// Returns whether a linear map leaves any area, so that it flattens at most one axis.
pub(crate) fn has_area(linear: DMat3) -> bool {
    let [x, y, z] = columns(linear);
    let areas: [DVec3; 3] = [x.cross(y), y.cross(z), z.cross(x)];
    areas.iter().any(|a| a.length() > 1e-18)
}

/// Computes one instance's pose from the world transforms of the hierarchy.
pub(crate) fn place(
    hierarchy: &NodeHierarchy,
    instance: &Instance,
    time_s: f64,
    worlds: &[DAffine3],
    slot: &mut InstancePose,
) {
    let node_to_world = instance.frame_node.map_or(DAffine3::IDENTITY, |node| worlds[node]);
    slot.frame = instance.constant_frame.unwrap_or_else(|| frame_of(&node_to_world));
    slot.visible = true;
    match &instance.deformer {
        Deformer::Rest => slot.deformation = Deformation::Rest,
        Deformer::Affine => {
            let linear = linear_in(&slot.frame, &node_to_world);
            slot.visible = has_area(linear);
            slot.deformation = Deformation::Affine(to_f32(linear));
        }
        Deformer::Morph => {
            let mut weights = match std::mem::take(&mut slot.deformation) {
                Deformation::Morph { weights, .. } => weights,
                _ => Vec::new(),
            };
            hierarchy.weights(instance.node, &instance.weights, time_s, &mut weights);
            let linear = linear_in(&slot.frame, &node_to_world);
            slot.visible = has_area(linear);
            slot.deformation = Deformation::Morph { weights, linear: to_f32(linear) };
        }
        Deformer::Skin { joints: nodes, inverse_bind, .. } => {
            let (mut joints, mut weights) = match std::mem::take(&mut slot.deformation) {
                Deformation::Skin { joints, weights } => (joints, weights),
                _ => (Vec::new(), Vec::new()),
            };
            let back = slot.frame.inverse();
            joints.clear();
            slot.visible = false;
            for (node, bind) in nodes.iter().zip(inverse_bind) {
                let matrix = back * worlds[*node] * *bind;
                slot.visible |= has_area(matrix.matrix3);
                joints.push(JointMatrix::new(&matrix));
            }
            hierarchy.weights(instance.node, &instance.weights, time_s, &mut weights);
            slot.deformation = Deformation::Skin { joints, weights };
        }
    }
    slot.visible &= hierarchy.visible(instance.node, time_s);
}
