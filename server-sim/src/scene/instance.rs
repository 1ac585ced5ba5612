//! Instances: one primitive at one node, and how it moves.

use glam::Mat3;
use psao_codec::memory;

use crate::scene::deform::JointMatrix;
use crate::scene::ids::{MeshId, RestId};
use crate::scene::needs::Needs;
use crate::scene::rigid::RigidFrame;

/// How an instance moves over the clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Not at all: its frame has the same bits at every time.
    Static,
    /// As a rigid body: its local geometry is its rest at every time.
    Rigid,
    /// Its local geometry changes.
    Deforming,
}

impl Motion {
    /// In a word, for people and documents.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Rigid => "rigid",
            Self::Deforming => "deforming",
        }
    }
}

/// How an instance's local geometry comes about.
#[derive(Debug, Clone)]
pub(crate) enum Deformer {
    /// It is the rest.
    Rest,
    /// The mesh under a linear map that changes.
    Affine,
    /// Morph targets, then a linear map (which may change too).
    Morph,
    /// Morph targets, then the joints of a skin.
    Skin { joints: Vec<usize>, inverse_bind: Vec<glam::DAffine3>, mirrored: bool },
}

/// One primitive at one node.
#[derive(Debug, Clone)]
pub struct Instance {
    pub(crate) name: String,
    pub(crate) mesh: MeshId,
    pub(crate) rest: RestId,
    pub(crate) motion: Motion,
    pub(crate) needs: Needs,
    pub(crate) deformer: Deformer,
    /// NodeHierarchy node whose rigid part is the frame; `None`: the world itself.
    pub(crate) frame_node: Option<usize>,
    /// NodeHierarchy node of the mesh, for its morph weights.
    pub(crate) node: usize,
    /// Default morph weights.
    pub(crate) weights: Vec<f32>,
    /// The frame, where it never changes.
    pub(crate) constant_frame: Option<RigidFrame>,
}

impl Instance {
    /// Name of its node (and primitive), may be empty.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The mesh it shows.
    #[must_use]
    pub fn mesh(&self) -> MeshId {
        self.mesh
    }

    /// The mesh at rest in metric local space.
    #[must_use]
    pub fn rest(&self) -> RestId {
        self.rest
    }

    /// How it moves.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// What it needs of a codec and a client.
    #[must_use]
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// Whether its frame has the same bits at every time; its local geometry may change all the same.
    #[must_use]
    pub fn has_constant_frame(&self) -> bool {
        self.constant_frame.is_some()
    }
}

/// What makes the local geometry of an instance at one time.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Deformation {
    /// The rest as it is.
    #[default]
    Rest,
    /// The mesh under a linear map.
    Affine(Mat3),
    /// Morph targets at these weights, then a linear map.
    Morph {
        /// One per morph target.
        weights: Vec<f32>,
        /// From mesh to local space.
        linear: Mat3,
    },
    /// Morph targets at these weights (none for most meshes), then the joints.
    Skin {
        /// One per joint of the skin, from mesh to local space.
        joints: Vec<JointMatrix>,
        /// One per morph target.
        weights: Vec<f32>,
    },
}

/// An instance at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct InstancePose {
    pub(crate) frame: RigidFrame,
    pub(crate) deformation: Deformation,
    pub(crate) visible: bool,
}

impl InstancePose {
    /// From local space to the world.
    #[must_use]
    pub fn frame(&self) -> &RigidFrame {
        &self.frame
    }

    /// What makes the local geometry.
    #[must_use]
    pub fn deformation(&self) -> &Deformation {
        &self.deformation
    }

    /// False while an animation has scaled it to nothing.
    #[must_use]
    pub fn visible(&self) -> bool {
        self.visible
    }
}

/// All instances of a scene at one time. Keep it from frame to frame: its memory is used again.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScenePose {
    pub(crate) time_s: f64,
    pub(crate) instances: Vec<InstancePose>,
    pub(crate) worlds: Vec<glam::DAffine3>,
}

impl ScenePose {
    /// Bytes held.
    pub(crate) fn heap_bytes(&self) -> usize {
        let posed = self.instances.iter().map(|instance| match &instance.deformation {
            Deformation::Rest | Deformation::Affine(_) => 0,
            Deformation::Morph { weights, .. } => memory::list(weights),
            Deformation::Skin { joints, weights } => memory::list(joints) + memory::list(weights),
        });
        memory::list(&self.instances) + memory::list(&self.worlds) + posed.sum::<usize>()
    }

    /// The time, seconds from the start of the clip.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The instances, in the order of the scene's.
    #[must_use]
    pub fn instances(&self) -> &[InstancePose] {
        &self.instances
    }
}
