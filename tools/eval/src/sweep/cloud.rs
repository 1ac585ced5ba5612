//! Measures cloud rendering: the server draws the AO picture itself, and sends it as video.

use psao_proto::message::CameraPose;
use psao_reconstruct::{AoImage, Size, cast_view};
use psao_server::ao::AoSettings;
use psao_server::world::SceneBvh;

use super::bench::{PictureSeries, empty};
use super::run::{frame_at, frames};
use super::video::FrameWork;
use super::{Bench, Clip, MemoryFigures, Record, RecordKind, Sample, SweepError, camera_lag};
use crate::adapter::SceneView;
use crate::reference::reference;
use crate::video::VideoCoder;

/// Stages of a server's frame, in order.
const SERVER_STAGES: [&str; 3] = ["pose", "cast view", "trace rays"];
/// Name of the method.
pub const CLOUD_VIDEO: &str = "cloud-video";

/// Settings of cloud rendering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudSettings {
    /// Rays a pixel.
    pub rays: u32,
    /// Frames a second of the server.
    pub fps: f32,
    /// Milliseconds by which the server's camera is behind the client's.
    pub camera_lag_ms: u32,
}

impl CloudSettings {
    /// Returns the settings in words and numbers, without the video coder.
    #[must_use]
    pub fn label(&self) -> String {
        format!("{} rays, {} Hz{}", self.rays, self.fps, camera_lag(self.camera_lag_ms))
    }
}

/// The pictures that a server traced of a clip.
pub struct CloudClip {
    settings: CloudSettings,
    /// Picture of each frame, in steps of 1/255, row by row.
    pictures: Vec<Vec<u8>>,
    work: Vec<FrameWork>,
    size: Size,
    seconds: f64,
}

impl CloudClip {
    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &CloudSettings {
        &self.settings
    }
}

impl Bench<'_> {
    /// Traces the picture of every frame of a clip, as the server's camera sees it.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when a camera is degenerate, or the rays are out of range.
    pub fn cloud_pictures(&self, clip: &Clip<'_>, settings: &CloudSettings) -> Result<CloudClip, SweepError> {
        let no_pictures = SweepError::NoPictures { seconds: clip.seconds };
        let size = self.views.first().ok_or(no_pictures)?.truth.size();
        let count = frames(clip.seconds, f64::from(settings.fps));
        let ao = clip.base.ao.with_rays(settings.rays);
        let mut world = SceneBvh::new(clip.scene, &clip.scene.pose(0.0));
        let (mut pictures, mut work) = (Vec::new(), Vec::new());
        for frame in 0..count {
            let (picture, done) = self.trace(clip, settings, &mut world, &ao, size, frame)?;
            pictures.push(picture);
            work.push(done);
        }
        Ok(CloudClip { settings: *settings, pictures, work, size, seconds: clip.seconds })
    }

    fn trace(
        &self,
        clip: &Clip<'_>,
        settings: &CloudSettings,
        world: &mut SceneBvh,
        ao: &AoSettings,
        size: Size,
        frame: u32,
    ) -> Result<(Vec<u8>, FrameWork), SweepError> {
        let time_s = f64::from(frame) / f64::from(settings.fps);
        let camera = clip.server_camera(time_s, settings.camera_lag_ms);
        let start = self.clock.micros();
        world.update(&clip.scene.pose(time_s));
        let posed = self.clock.micros();
        let view = SceneView::new(world);
        let buffer = cast_view(&view, &CameraPose { aspect: size.aspect(), ..camera }, size)?;
        let cast = self.clock.micros();
        let picture = reference(&view, &buffer, ao)?;
        let traced = self.clock.micros();
        let micros =
            [(start, posed), (posed, cast), (cast, traced)].map(|(from, to)| to.saturating_sub(from));
        let picture = picture.values().iter().map(|&value| (value * 255.0).round() as u8).collect();
        Ok((picture, FrameWork { values: size.pixels() as u64, other_bytes: 0, micros }))
    }

    /// Codes and decodes traced pictures as video, and compares them with what the client should see.
    ///
    /// The client shows the newest picture that began by its time, as it is. `key` goes into the record.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when the video coder fails.
    pub fn cloud(&self, key: &str, clip: &CloudClip, coder: &dyn VideoCoder) -> Result<Sample, SweepError> {
        let video = self.code(coder, clip.size, clip.settings.fps, &clip.pictures)?;
        let mut drawn = PictureSeries::default();
        for view in self.views {
            let frame = frame_at(view.time_s, f64::from(clip.settings.fps), clip.pictures.len() as u32);
            let picture = video.clip.frames[frame as usize].iter().map(|&value| f32::from(value) / 255.0);
            let picture =
                AoImage::new(clip.size, picture.collect()).map_err(crate::screen::ScreenError::from)?;
            self.compare(view, picture, 0.0, &mut drawn)?;
        }
        let record = Record {
            key: key.to_owned(),
            scene: self.scene.to_owned(),
            kind: RecordKind::Cloud,
            name: CLOUD_VIDEO.to_owned(),
            label: format!("{}, {}", clip.settings.label(), coder.label()),
            picture_ms: video.decode,
            stages: video.stages(SERVER_STAGES, &clip.work),
            stream: Some(video.figures(clip.settings.fps, &clip.work)),
            memory: MemoryFigures {
                state_bytes: Some(clip.size.pixels() as u64),
                largest_frame_bytes: video.clip.bytes.iter().max().copied(),
                ..MemoryFigures::default()
            },
            ..empty()
        };
        drawn.sample(record).ok_or(SweepError::NoPictures { seconds: clip.seconds })
    }
}
