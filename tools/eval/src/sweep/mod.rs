//! Sweeps of settings and methods over a clip. All are measured in the same way against the same references.
//!
//! [`views`] draws the pictures of a clip and traces their references, once. A [`Bench`] then runs a stream from the
//! scene to those pictures ([`Bench::stream`], [`Bench::texture`], [`Bench::cloud`]), or a screen-space method over them
//! ([`Bench::method`]). The result is a [`Record`] of cost and error. [`SettingGrid`] lists the settings.
//!
//! Times of a stream's server, encoder and decoder cover every frame after the first state, in each of
//! [`RunCounts::repeats`] runs of the whole clip. All runs must give the same bytes. Times of reconstruction and of
//! screen-space methods cover [`RunCounts::repeats`] runs a picture, after [`RunCounts::warm_up`] runs that do not
//! count. The caller provides the clock.

mod bench;
mod cloud;
mod methods;
mod record;
mod run;
mod setting;
mod texture;
mod video;
mod views;

use psao_codec::envelope::{FrameError, FrameIndex};
use psao_proto::message::MessageError;
use psao_reconstruct::{CameraError, ReconstructError};
use psao_server::server::ServerError;

pub use self::bench::{Bench, RunCounts, Sample};
pub use self::cloud::{CLOUD_VIDEO, CloudClip, CloudSettings};
pub use self::methods::{far_field_methods, pyramid_methods, screen_methods};
pub use self::record::{
    ErrorFigures, MemoryFigures, PictureFigures, Record, RecordAtRadius, RecordKind, Spread, StageTime,
    StreamFigures,
};
pub use self::run::{Clip, FrameBytes};
pub(crate) use self::setting::camera_lag;
pub use self::setting::{Setting, SettingGrid, SettingSummary};
pub use self::texture::{AtlasClip, TEXTURE_SPACE};
pub use self::views::{ReferenceRays, View, picture_times, reach_px, views};

use crate::metric::MetricError;
use crate::reference::ReferenceError;
use crate::screen::ScreenError;
use crate::texture::TextureError;
use crate::video::VideoError;

/// Error of a measurement.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// The server refused the setting, or failed.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// The scene's tables do not fit into their messages.
    #[error(transparent)]
    Table(#[from] MessageError),
    /// A camera of the scene is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The references could not be traced.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A screen could not be made, or a method refused it.
    #[error(transparent)]
    Screen(#[from] ScreenError),
    /// A texture-space stream was refused.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// The video coder failed.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A picture could not be reconstructed.
    #[error(transparent)]
    Reconstruct(#[from] ReconstructError),
    /// Two pictures could not be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// The client refused a frame.
    #[error("frame {frame}: {error}")]
    Frame {
        /// The frame.
        frame: FrameIndex,
        /// Error of the decoder.
        error: FrameError,
    },
    /// A repeated run ended in another state.
    #[error("run {run} ended in another state than the first run: the stream is not reproducible")]
    Repeat {
        /// Number of the run, from 1.
        run: u32,
    },
    /// The clip has no picture to measure.
    #[error("a clip of {seconds} s has no picture; ask for at least one")]
    NoPictures {
        /// Length of the clip.
        seconds: f64,
    },
}
