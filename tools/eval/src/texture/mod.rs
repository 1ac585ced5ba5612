//! Ambient occlusion in a texture atlas that is sent as video, for comparison with point-based streams.
//!
//! It follows shading atlas streaming as section 4 of the PSAO paper describes it. Two triangles that share an edge
//! make a patch ([`Patches`]). Each patch in view has a block of texels ([`Atlas`]): the pixels that it covers on a
//! full-size screen over a divisor each way, at least 2 x 2 ([`TextureSettings`]).
//!
//! The blocks are traced in every frame, and a video coder
//! ([`VideoCoder`](crate::video::VideoCoder)) sends the atlas. A client looks a pixel up
//! in the decoded atlas and interpolates between texels. The paper and the code of the original were not available, so
//! further details of it are missing here.

mod atlas;
mod frame;
mod pairs;
mod patches;
mod placement;
mod settings;
#[cfg(test)]
mod tests;
mod visible;

pub use self::atlas::{Atlas, AtlasFullError, Block, Extent};
pub(crate) use self::frame::EMPTY_TEXEL;
pub use self::frame::{BlockMap, TextureServer, TextureStats};
pub use self::patches::{Patch, PatchPoint, Patches};
pub use self::settings::{TextureError, TextureSettings};
pub use self::visible::{PatchLookup, patch_lookup};
