//! The memory of a running server.

/// Bytes that a server holds between two frames, by part.
///
/// Folded from the sizes of what is held, room that lists keep included: the same on any machine of one word size with the
/// same build. Not in it: the scene, which its owner has anyway; what threads take while they trace, tens of kB each; tables
/// of the scene that clients are sent first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerMemory {
    /// Trees over the triangles, with a copy of their own and of the posed vertices for each instance that deforms; the pose.
    pub structures: usize,
    /// Points: on their meshes, where they are now, their AO and what is known of it.
    pub points: usize,
    /// Directions of the sets of rays that points choose from.
    pub rays: usize,
    /// What points remember of their rays' hits, at most [`ServerSettings::ray_memory`](super::ServerSettings::ray_memory).
    pub remembered: usize,
    /// The stream: what clients hold, tables and models of the encoder, buffers.
    pub stream: usize,
}

impl ServerMemory {
    /// All parts together.
    #[must_use]
    pub fn total(&self) -> usize {
        let Self { structures, points, rays, remembered, stream } = *self;
        structures + points + rays + remembered + stream
    }
}
