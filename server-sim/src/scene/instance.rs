//! Instances: one primitive at one node, and its motion.

use glam::Mat3;
use psao_codec::memory;

use crate::scene::deform::JointMatrix;
use crate::scene::ids::{MeshId, RestId};
use crate::scene::needs::Needs;
use crate::scene::rigid::RigidFrame;

/// Motion of an instance over the clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// The frame has the same bits at every time, and so has the local geometry. An animation never hides it.
    Static,
    /// The instance moves as a rigid body, or appears and disappears: its local geometry is its rest at every time.
    Rigid,
    /// The local geometry changes.
    Deforming,
}

impl Motion {
    /// Returns a word for users and documents.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Rigid => "rigid",
            Self::Deforming => "deforming",
        }
    }
}

/// The way in which an instance's local geometry is computed.
#[derive(Debug, Clone)]
pub(crate) enum Deformer {
    /// The local geometry is the rest.
    Rest,
    /// The mesh is transformed by a changing linear map.
    Affine,
    /// Morph targets act first, then a linear map, which may change too.
    Morph,
    /// Morph targets act first, then the joints of a skin.
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
    /// Hierarchy node whose rigid part is the frame; `None` for the world itself.
    pub(crate) frame_node: Option<usize>,
    /// Hierarchy node of the mesh, for its morph weights.
    pub(crate) node: usize,
    /// Default morph weights.
    pub(crate) weights: Vec<f32>,
    /// The frame, if it never changes.
    pub(crate) constant_frame: Option<RigidFrame>,
}

impl Instance {
    /// Returns the name of its node and primitive; it may be empty.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the id of its mesh.
    #[must_use]
    pub fn mesh(&self) -> MeshId {
        self.mesh
    }

    /// Returns the id of its mesh at rest in metric local space.
    #[must_use]
    pub fn rest(&self) -> RestId {
        self.rest
    }

    /// Returns how it moves.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// Returns the features that it requires of a codec and a client.
    #[must_use]
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// Returns whether its frame has the same bits at every time. Its local geometry may still change.
    #[must_use]
    pub fn has_constant_frame(&self) -> bool {
        self.constant_frame.is_some()
    }
}

/// Deformation of an instance's local geometry at a given time.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Deformation {
    /// The rest, unchanged.
    #[default]
    Rest,
    /// The mesh under a linear map.
    Affine(Mat3),
    /// Morph targets at given weights, then a linear map.
    Morph {
        /// One weight per morph target.
        weights: Vec<f32>,
        /// Linear map from mesh space to local space.
        linear: Mat3,
    },
    /// Morph targets at given weights (most meshes have none), then the joints.
    Skin {
        /// One matrix per joint of the skin, from mesh space to local space.
        joints: Vec<JointMatrix>,
        /// One weight per morph target.
        weights: Vec<f32>,
    },
}

/// State of an instance at a given time.
#[derive(Debug, Clone, PartialEq)]
pub struct InstancePose {
    pub(crate) frame: RigidFrame,
    pub(crate) deformation: Deformation,
    pub(crate) visible: bool,
}

impl InstancePose {
    /// Returns the frame from local space to the world.
    #[must_use]
    pub fn frame(&self) -> &RigidFrame {
        &self.frame
    }

    /// Returns the deformation of the local geometry.
    #[must_use]
    pub fn deformation(&self) -> &Deformation {
        &self.deformation
    }

    /// Returns false while an animation has scaled it to nothing or hides it, or an edit hides it.
    #[must_use]
    pub fn visible(&self) -> bool {
        self.visible
    }
}

/// All instances of a scene at a given time. Keep the value from frame to frame to reuse its memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScenePose {
    pub(crate) time_s: f64,
    pub(crate) instances: Vec<InstancePose>,
    pub(crate) worlds: Vec<glam::DAffine3>,
}

impl ScenePose {
    /// Returns the bytes held on the heap.
    pub(crate) fn heap_bytes(&self) -> usize {
        let posed = self.instances.iter().map(|instance| match &instance.deformation {
            Deformation::Rest | Deformation::Affine(_) => 0,
            Deformation::Morph { weights, .. } => memory::list(weights),
            Deformation::Skin { joints, weights } => memory::list(joints) + memory::list(weights),
        });
        memory::list(&self.instances) + memory::list(&self.worlds) + posed.sum::<usize>()
    }

    /// Returns the time in seconds from the start of the clip.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the instances in the order of the scene.
    #[must_use]
    pub fn instances(&self) -> &[InstancePose] {
        &self.instances
    }
}
