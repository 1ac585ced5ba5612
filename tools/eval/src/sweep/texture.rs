//! Measures a texture-space stream.

use std::sync::Arc;

use psao_proto::message::CameraPose;
use psao_reconstruct::{Camera, Size};
use psao_server::world::SceneBvh;

use super::bench::{PictureSeries, buffer_bytes, empty};
use super::run::{frame_at, frames};
use super::{
    Bench, Clip, MemoryFigures, Record, RecordKind, Sample, Spread, StageTime, StreamFigures, SweepError,
};
use crate::texture::{
    Atlas, BlockMap, PatchLookup, Patches, TextureServer, TextureSettings, TextureStats, VideoClip,
    VideoCoder, patch_lookup,
};

/// Stages of a server's frame, in order.
const SERVER_STAGES: [&str; 3] = ["pose", "find what is in view", "trace rays"];
/// Name of the method.
pub const TEXTURE_SPACE: &str = "texture-space";

/// The server's output for a clip.
#[derive(Default)]
struct AtlasClip {
    /// Atlas of each frame; all have the same size once the clip is over.
    atlases: Vec<Vec<u8>>,
    stats: Vec<TextureStats>,
    rows: u32,
    /// Block map of each picture.
    shown: Vec<Option<BlockMap>>,
}

impl Bench<'_> {
    /// Runs a texture-space stream: traces the patches in view, codes and decodes the atlas as video, looks pixels up
    /// and compares the pictures.
    ///
    /// As with [`Bench::stream`], a picture is drawn with the newest frame that began by its time. The clip is traced
    /// once; coding and decoding are repeated. `key` goes into the record.
    ///
    /// # Errors
    ///
    /// [`SweepError`] when a setting is out of its range, too much is in view for an atlas, or the video coder fails.
    pub fn texture(
        &self,
        key: &str,
        clip: &Clip<'_>,
        settings: &TextureSettings,
        coder: &dyn VideoCoder,
    ) -> Result<Sample, SweepError> {
        let patches = Arc::new(Patches::new(clip.scene));
        let count = frames(clip.seconds, f64::from(settings.fps));
        let frame_at = |time_s| frame_at(time_s, f64::from(settings.fps), count);
        let shaded = self.shade(clip, settings, &patches, count, &frame_at)?;
        let size = Size::new(Atlas::WIDTH, shaded.rows.max(1)).map_err(crate::screen::ScreenError::from)?;
        let mut coded: Option<VideoClip> = None;
        let (mut encode, mut decode) = (Vec::new(), Vec::new());
        for _ in 0..self.runs.repeats.max(1) {
            let run = coder.code(size, settings.fps, &shaded.atlases)?;
            run.check(&shaded.atlases)?;
            encode.push(run.encode_micros as f64 / 1e3 / f64::from(count));
            decode.push(run.decode_micros as f64 / 1e3 / f64::from(count));
            coded = Some(run);
        }
        let coded = coded.ok_or(SweepError::NoPictures { seconds: clip.seconds })?;
        let mut drawn = PictureSeries::default();
        for (view, shown) in self.views.iter().zip(&shaded.shown) {
            let looked = self.look(clip, &patches, view.time_s, view.truth.size())?;
            let atlas = &coded.frames[frame_at(view.time_s) as usize];
            if let Some(shown) = shown {
                self.look_up(shown, atlas, &looked, view, &mut drawn)?;
            }
        }
        let (encode, decode) = (Spread::of(encode), Spread::of(decode));
        let picture_ms = drawn.micros.iter().map(|micros| decode.median + *micros as f64 / 1e3).collect();
        let record = Record {
            key: key.to_owned(),
            scene: self.scene.to_owned(),
            kind: RecordKind::Texture,
            name: TEXTURE_SPACE.to_owned(),
            label: format!("{}, {}", settings.label(), coder.label()),
            picture_ms: Spread::of(picture_ms),
            stages: stages(&shaded, encode, decode, &drawn),
            stream: Some(figures(&shaded, &coded, settings, encode)),
            memory: MemoryFigures {
                picture_bytes: buffer_bytes(self.views),
                state_bytes: Some(size.pixels() as u64),
                largest_frame_bytes: coded.bytes.iter().max().copied(),
                ..MemoryFigures::default()
            },
            ..empty()
        };
        drawn.sample(record).ok_or(SweepError::NoPictures { seconds: clip.seconds })
    }

    /// Traces the clip.
    fn shade(
        &self,
        clip: &Clip<'_>,
        settings: &TextureSettings,
        patches: &Arc<Patches>,
        count: u32,
        frame_at: &dyn Fn(f64) -> u32,
    ) -> Result<AtlasClip, SweepError> {
        let mut server = TextureServer::new(clip.scene, patches, *settings, &clip.base.ao)?;
        let mut shaded = AtlasClip { shown: vec![None; self.views.len()], ..AtlasClip::default() };
        let aspect = self.views.first().map_or(1.0, |view| view.truth.size().aspect());
        for frame in 0..count {
            let time_s = f64::from(frame) / f64::from(settings.fps);
            let camera = CameraPose { aspect, ..clip.scene.camera(time_s) };
            shaded.stats.push(server.step(time_s, &camera, self.clock)?);
            shaded.atlases.push(server.texels().to_vec());
            for (shown, view) in shaded.shown.iter_mut().zip(self.views) {
                if frame_at(view.time_s) == frame {
                    *shown = Some(server.block_map());
                }
            }
        }
        shaded.rows = server.rows();
        let all = server.texels().len();
        shaded.atlases.iter_mut().for_each(|atlas| atlas.resize(all, u8::MAX));
        Ok(shaded)
    }

    /// Returns the patches of a picture's pixels.
    fn look(
        &self,
        clip: &Clip<'_>,
        patches: &Patches,
        time_s: f64,
        size: Size,
    ) -> Result<PatchLookup, SweepError> {
        let world = SceneBvh::new(clip.scene, &clip.scene.pose(time_s));
        let camera = Camera::new(&CameraPose { aspect: size.aspect(), ..clip.scene.camera(time_s) })?;
        Ok(patch_lookup(&world, patches, &camera, size))
    }

    fn look_up(
        &self,
        shown: &BlockMap,
        atlas: &[u8],
        looked: &PatchLookup,
        view: &super::View,
        drawn: &mut PictureSeries,
    ) -> Result<(), SweepError> {
        let picture = || shown.picture(atlas, looked).map_err(crate::screen::ScreenError::from);
        let mut found = picture()?;
        for run in 0..self.runs.warm_up + self.runs.repeats.max(1) {
            let start = self.clock.micros();
            found = picture()?;
            if run >= self.runs.warm_up {
                drawn.micros.push(self.clock.micros().saturating_sub(start));
            }
        }
        self.compare(view, found.0, found.1, drawn)
    }
}

fn stages(shaded: &AtlasClip, encode: Spread, decode: Spread, drawn: &PictureSeries) -> Vec<StageTime> {
    let stage = |side: &str, name: &str, ms| StageTime { side: side.to_owned(), name: name.to_owned(), ms };
    let later = &shaded.stats[1..];
    let server = SERVER_STAGES.iter().enumerate().map(|(number, name)| {
        let micros: Vec<u64> = later.iter().map(|frame| frame.micros[number]).collect();
        stage("server", name, Spread::of_micros(&micros))
    });
    let coding = [("server", "encode", encode), ("client", "decode", decode)];
    let looking = stage("client", "look up", Spread::of_micros(&drawn.micros));
    server.chain(coding.map(|(side, name, ms)| stage(side, name, ms))).chain([looking]).collect()
}

/// Returns the size and times of the stream. Its points are the texels that the clip's last frame traced.
fn figures(
    shaded: &AtlasClip,
    coded: &VideoClip,
    settings: &TextureSettings,
    encode: Spread,
) -> StreamFigures {
    let frames = shaded.stats.len() as u32;
    let seconds = f64::from(frames - 1) / f64::from(settings.fps);
    let mbit_s = |bytes: u64| bytes as f64 * 8.0 / 1e6 / seconds;
    let ms = |frame: &TextureStats| frame.micros.iter().sum::<u64>() as f64 / 1e3 + encode.median;
    let (first, later) = (&shaded.stats[0], &shaded.stats[1..]);
    let video: u64 = coded.bytes[1..].iter().sum();
    let placement: u64 = later.iter().map(|frame| frame.placement_bytes).sum();
    StreamFigures {
        frames,
        points: shaded.stats.last().map_or(0, |frame| frame.texels as u32),
        scene_table_bytes: 0,
        first_state_bytes: coded.bytes[0] + first.placement_bytes,
        later_bytes: video + placement,
        changed_points: later.iter().map(|frame| frame.texels).sum(),
        paper_mbit_s: mbit_s(video),
        wire_mbit_s: mbit_s(video + placement),
        first_frame_ms: ms(first),
        server_ms: Spread::of(later.iter().map(ms).collect()),
    }
}
