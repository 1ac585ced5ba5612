//! Measures a texture-space stream.

use std::sync::Arc;

use psao_proto::message::CameraPose;
use psao_reconstruct::{Camera, Size};
use psao_server::world::SceneBvh;

use super::bench::{PictureSeries, buffer_bytes, empty};
use super::run::{frame_at, frames};
use super::video::FrameWork;
use super::{Bench, Clip, MemoryFigures, Record, RecordKind, Sample, Spread, StageTime, SweepError, View};
use crate::texture::{
    Atlas, BlockMap, EMPTY_TEXEL, PatchLookup, Patches, TextureServer, TextureSettings, TextureStats,
    patch_lookup,
};
use crate::video::VideoCoder;

/// Stages of a server's frame, in order.
const SERVER_STAGES: [&str; 3] = ["pose", "find what is in view", "trace rays"];
/// Name of the method.
pub const TEXTURE_SPACE: &str = "texture-space";

/// The traced atlases of a clip, and where each picture's pixels are in them.
pub struct AtlasClip {
    settings: TextureSettings,
    /// Atlas of each frame; all have the same size.
    atlases: Vec<Vec<u8>>,
    work: Vec<FrameWork>,
    size: Size,
    seconds: f64,
    pictures: Vec<AtlasView>,
}

/// A picture's frame, the blocks in it, and the patches of its pixels.
struct AtlasView {
    frame: u32,
    blocks: BlockMap,
    patches: PatchLookup,
}

impl AtlasClip {
    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &TextureSettings {
        &self.settings
    }
}

impl Bench<'_> {
    /// Traces the patches in view of every frame of a clip.
    ///
    /// As with [`Bench::stream`], a picture is drawn with the newest frame that began by its time.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when a setting is out of its range, or too much is in view for an atlas.
    pub fn atlases(&self, clip: &Clip<'_>, settings: &TextureSettings) -> Result<AtlasClip, SweepError> {
        let patches = Arc::new(Patches::new(clip.scene));
        let count = frames(clip.seconds, f64::from(settings.fps));
        let mut server = TextureServer::new(clip.scene, &patches, *settings, &clip.base.ao)?;
        let (mut atlases, mut work, mut pictures) = (Vec::new(), Vec::new(), Vec::new());
        let aspect = self.views.first().map_or(1.0, |view| view.truth.size().aspect());
        for frame in 0..count {
            let time_s = f64::from(frame) / f64::from(settings.fps);
            let camera = CameraPose { aspect, ..clip.server_camera(time_s, settings.camera_lag_ms) };
            work.push(FrameWork::from(server.step(time_s, &camera, self.clock)?));
            atlases.push(server.texels().to_vec());
            for view in self.views.iter().filter(|view| shown(view, settings.fps, count) == frame) {
                let patches = look(clip, &patches, view)?;
                pictures.push(AtlasView { frame, blocks: server.block_map(), patches });
            }
        }
        let size = Size::new(Atlas::WIDTH, server.rows().max(1)).map_err(crate::screen::ScreenError::from)?;
        atlases.iter_mut().for_each(|atlas| atlas.resize(server.texels().len(), EMPTY_TEXEL));
        Ok(AtlasClip { settings: *settings, atlases, work, size, seconds: clip.seconds, pictures })
    }

    /// Codes and decodes traced atlases as video, looks pixels up and compares the pictures. `key` goes into the record.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when the video coder fails.
    pub fn texture(&self, key: &str, clip: &AtlasClip, coder: &dyn VideoCoder) -> Result<Sample, SweepError> {
        let video = self.code(coder, clip.size, clip.settings.fps, &clip.atlases)?;
        let mut drawn = PictureSeries::default();
        for (view, picture) in self.views.iter().zip(&clip.pictures) {
            self.look_up(picture, &video.clip.frames[picture.frame as usize], view, &mut drawn)?;
        }
        let decode = video.decode.median;
        let picture_ms = drawn.micros.iter().map(|micros| decode + *micros as f64 / 1e3).collect();
        let mut stages = video.stages(SERVER_STAGES, &clip.work);
        let looking = Spread::of_micros(&drawn.micros);
        stages.push(StageTime { side: "client".to_owned(), name: "look up".to_owned(), ms: looking });
        let record = Record {
            key: key.to_owned(),
            scene: self.scene.to_owned(),
            kind: RecordKind::Texture,
            name: TEXTURE_SPACE.to_owned(),
            label: format!("{}, {}", clip.settings.label(), coder.label()),
            picture_ms: Spread::of(picture_ms),
            stages,
            stream: Some(video.figures(clip.settings.fps, &clip.work)),
            memory: MemoryFigures {
                picture_bytes: buffer_bytes(self.views),
                state_bytes: Some(clip.size.pixels() as u64),
                largest_frame_bytes: video.clip.bytes.iter().max().copied(),
                ..MemoryFigures::default()
            },
            ..empty()
        };
        drawn.sample(record).ok_or(SweepError::NoPictures { seconds: clip.seconds })
    }

    fn look_up(
        &self,
        picture: &AtlasView,
        atlas: &[u8],
        view: &View,
        drawn: &mut PictureSeries,
    ) -> Result<(), SweepError> {
        let draw =
            || picture.blocks.picture(atlas, &picture.patches).map_err(crate::screen::ScreenError::from);
        let mut found = draw()?;
        for run in 0..self.runs.warm_up + self.runs.repeats.max(1) {
            let start = self.clock.micros();
            found = draw()?;
            if run >= self.runs.warm_up {
                drawn.micros.push(self.clock.micros().saturating_sub(start));
            }
        }
        self.compare(view, found.0, found.1, drawn)
    }
}

/// Returns the frame that a view shows.
fn shown(view: &View, fps: f32, count: u32) -> u32 {
    frame_at(view.time_s, f64::from(fps), count)
}

/// Returns the patches of a picture's pixels.
fn look(clip: &Clip<'_>, patches: &Patches, view: &View) -> Result<PatchLookup, SweepError> {
    let world = SceneBvh::new(clip.scene, &clip.scene.pose(view.time_s));
    Ok(patch_lookup(&world, patches, &Camera::new(&view.camera)?, view.truth.size()))
}

impl From<TextureStats> for FrameWork {
    fn from(stats: TextureStats) -> Self {
        Self { values: stats.texels, other_bytes: stats.placement_bytes, micros: stats.micros }
    }
}
