//! Why a stream cannot be published.

use psao_codec::envelope::EncodeError;
use psao_codec::surface::GeometryError;
use psao_proto::SceneError;

use super::InstanceId;

/// Why a stream cannot be published.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PublishError {
    /// A setting is out of its range.
    #[error("{setting} is out of its range: choose {range}")]
    Setting {
        /// The setting.
        setting: &'static str,
        /// The values that it may have.
        range: &'static str,
    },
    /// An instance of a mesh that was not added.
    #[error(
        "instance {instance} is of mesh {mesh}, but the stream has {meshes} meshes: add it with `mesh` first"
    )]
    NoMesh {
        /// Number of the instance.
        instance: u32,
        /// Number of its mesh.
        mesh: u32,
        /// Meshes of the stream.
        meshes: u32,
    },
    /// A value for a point that the stream does not have.
    #[error("the stream has no point {point} of instance {}", instance.0)]
    NoPoint {
        /// The instance.
        instance: InstanceId,
        /// The point, in the order in which the mesh was given.
        point: usize,
    },
    /// Values for all points of an instance, but not as many as it has points.
    #[error("instance {} has {points} points, but {found} values were given", instance.0)]
    Values {
        /// The instance.
        instance: InstanceId,
        /// Points that it has; 0 where the stream does not have it.
        points: usize,
        /// Values given.
        found: usize,
    },
    /// A recording was asked for after the first frame.
    #[error("the stream has begun: start its recording before the first frame")]
    Begun,
    /// The stream has more points or instances than the limits allow, or a kernel radius makes no lattice.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The points do not make the stream's geometry.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The frame cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The frame was written, but a client or the recording could not get it.
    #[cfg(any(feature = "tokio", feature = "fs"))]
    #[error(transparent)]
    Sink(#[from] psao_proto::sinks::SinkError),
    /// The recording cannot be started.
    #[cfg(feature = "fs")]
    #[error(transparent)]
    Record(#[from] psao_proto::recording::file::FileError),
    /// The text is not an address.
    #[cfg(feature = "tokio")]
    #[error(transparent)]
    Address(#[from] psao_proto::net::AddressError),
    /// Nothing can listen at the address.
    #[cfg(feature = "tokio")]
    #[error(transparent)]
    Network(#[from] psao_proto::net::NetError),
    /// The system gave no thread for the network.
    #[cfg(feature = "tokio")]
    #[error("cannot start the network's thread: {source}")]
    Runtime {
        /// What the system said.
        source: std::io::Error,
    },
}
