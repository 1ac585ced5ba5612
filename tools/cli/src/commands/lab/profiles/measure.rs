//! Runs both profiles frame by frame and notes what each costs.

use std::path::Path;
use std::sync::Arc;

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::surface::{BitBreakdown, bit_breakdown, preview};
use psao_codec::{Decoder, State};
use psao_eval::adapter::SceneView;
use psao_eval::metric::Comparison;
use psao_eval::reference::reference;
use psao_proto::message::{CameraPose, PointSource};
use psao_proto::{HEADER_BYTES, Limits, SceneTable};
use psao_reconstruct::picture::Picture;
use psao_reconstruct::reconstruct::Reconstruction;
use psao_reconstruct::{AoImage, GBuffer, Size, cast_view};
use psao_server::ao::AoSettings;
use psao_server::points::make_shared_geometry;
use psao_server::scene::Scene;
use psao_server::server::{AoErrorStats, BothProfiles, PerProfile, ServerSettings, StepOutput};

use super::Args;
use crate::analysis::{PARTS, parts_of};
use crate::context::{Stopwatch, progress};
use crate::error::{Exit, Failure, Outcome};
use crate::pictures::blend;

/// What a profile cost and gave.
#[derive(Default)]
pub(super) struct Side {
    pub(super) frames: Vec<Line>,
    /// Wire bytes of the scene table.
    pub(super) scene_bytes: u64,
    /// Wire bytes of a keyframe for a client that joins after the last frame.
    pub(super) join_bytes: u64,
    /// Over all frames after the first.
    pub(super) error: AoErrorStats,
    pub(super) pictures: Vec<Seen>,
    /// Wire bytes of the first frame after which a client can draw all that the first picture shows.
    pub(super) first_picture_bytes: Option<u64>,
    /// What the bits of range-coded changes were spent on, all frames together.
    pub(super) spent: BitBreakdown,
}

/// One frame.
pub(super) struct Line {
    /// Wire bytes by part, in the order of [`PARTS`].
    pub(super) parts: [u64; PARTS.len()],
    pub(super) changed: u32,
    /// Milliseconds: what to send, and writing it; applying it.
    pub(super) encode_ms: f64,
    pub(super) decode_ms: f64,
}

/// One picture.
pub(super) struct Seen {
    pub(super) frame: u32,
    pub(super) comparison: Comparison,
    /// Share of the fragments that no point supports.
    pub(super) unsupported: f64,
}

/// A client that follows one profile.
struct Client {
    state: State,
    decoder: Decoder,
    name: &'static str,
}

impl Client {
    fn new(name: &'static str, table: &SceneTable) -> Self {
        Self { state: State::new(table.layout()), decoder: Decoder::new(), name }
    }

    /// Applies a frame; its hash must be the server's.
    fn follow(&mut self, output: &StepOutput) -> Outcome<Line> {
        let start = Stopwatch::start();
        let applied = self.decoder.decode(&mut self.state, &output.body, &Limits::default().codec);
        let decode_ms = start.millis();
        applied.map_err(|error| {
            let (name, frame) = (self.name, output.info.frame);
            Failure::new(Exit::Check, format_args!("profile {name}, frame {frame}: {error}"))
        })?;
        let micros = output.stats.micros;
        Ok(Line {
            parts: parts_of(&output.info),
            changed: output.stats.changed,
            encode_ms: (micros.decide + micros.encode) as f64 / 1e3,
            decode_ms,
        })
    }
}

/// Runs all frames.
pub(super) fn measure(
    args: &Args,
    scene: &Arc<Scene>,
    settings: &ServerSettings,
    surface_coder: BlockCoder,
    both: &mut BothProfiles,
) -> Outcome<PerProfile<Side>> {
    let tables = both.tables();
    let mut sides = PerProfile { paper: begin(tables.paper)?, surface: begin(tables.surface)? };
    let mut paper = Client::new("paper", tables.paper);
    let mut surface = Client::new("surface", tables.surface);
    let info = tables.surface.info().clone();
    if let (PointSource::SHARED, Some(state)) = (info.geometry, surface.state.as_surface_mut()) {
        make_shared_geometry(scene, &info, state).map_err(Failure::input)?;
    }
    let clock = Stopwatch::start();
    let bar = progress("comparing", u64::from(args.frames));
    let mut last = (FrameIndex(0), StreamTime(0));
    for number in 0..args.frames {
        let time_s = f64::from(number) / f64::from(args.points.fps);
        last = (FrameIndex(number), StreamTime((time_s * 1e6).round() as u64));
        let own = [scene.camera(time_s)];
        let cameras: &[CameraPose] = if args.points.all_visible { &[] } else { &own };
        let outputs = both.step(last.0, last.1, cameras, &clock).map_err(crate::producer::refused)?;
        sides.paper.frames.push(paper.follow(&outputs.paper)?);
        if let Some(before) = surface.state.as_surface() {
            let spent = bit_breakdown(before, &outputs.surface.body, &Limits::default().codec);
            sides.surface.spent += spent.map_err(Failure::input)?.unwrap_or_default();
        }
        sides.surface.frames.push(surface.follow(&outputs.surface)?);
        if let (Some(state), true) = (surface.state.as_surface(), number > 0) {
            let errors = both.errors(state);
            sides.paper.error.merge(&errors.paper);
            sides.surface.error.merge(&errors.surface);
        }
        if args.pictures.contains(&number) {
            let shot = Shot { args, ao: settings.ao, both, camera: own[0], frame: number };
            let seen = shot.draw(&paper.state, &surface.state)?;
            if number == 0 {
                // The paper's tables come whole or not at all.
                sides.paper.first_picture_bytes = Some((HEADER_BYTES + outputs.paper.body.len()) as u64);
                sides.surface.first_picture_bytes = Some(shot.first_bytes(&surface.state, &outputs.surface)?);
            }
            sides.paper.pictures.push(seen.paper);
            sides.surface.pictures.push(seen.surface);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let coders = PerProfile { paper: settings.coder, surface: surface_coder };
    let joins = both.keyframes(last.0, last.1, coders).map_err(crate::producer::refused)?;
    sides.paper.join_bytes = (HEADER_BYTES + joins.paper.len()) as u64;
    sides.surface.join_bytes = (HEADER_BYTES + joins.surface.len()) as u64;
    Ok(sides)
}

fn begin(table: &SceneTable) -> Outcome<Side> {
    let payloads = table.payloads().map_err(Failure::input)?;
    let scene_bytes = payloads.iter().map(|payload| (HEADER_BYTES + payload.len()) as u64).sum();
    Ok(Side { scene_bytes, ..Side::default() })
}

/// A frame to be drawn in both profiles, and by rays.
struct Shot<'a> {
    args: &'a Args,
    ao: AoSettings,
    both: &'a BothProfiles,
    camera: CameraPose,
    frame: u32,
}

impl Shot<'_> {
    fn draw(&self, paper: &State, surface: &State) -> Outcome<PerProfile<Seen>> {
        let view = SceneView::new(self.both.world());
        let buffer = self.look(&view)?;
        let rays = self.ao.with_rays(self.args.reference_rays);
        let truth = reference(&view, &buffer, &rays).map_err(Failure::reference)?;
        let [paper, surface] = [self.blend(paper, &buffer)?, self.blend(surface, &buffer)?];
        if let Some(folder) = &self.args.output {
            self.write(folder, &truth, [&paper.image, &surface.image])?;
        }
        Ok(PerProfile { paper: self.seen(&truth, &paper)?, surface: self.seen(&truth, &surface)? })
    }

    fn blend(&self, state: &State, buffer: &GBuffer) -> Outcome<Reconstruction> {
        blend(state, self.both.tables().surface.info(), buffer, &self.camera)
    }

    fn look(&self, view: &SceneView<'_>) -> Outcome<GBuffer> {
        let size = Size::new(self.args.size.width, self.args.size.height).map_err(Failure::usage)?;
        let camera = CameraPose { aspect: size.aspect(), ..self.camera };
        cast_view(view, &camera, size).map_err(Failure::input)
    }

    /// Wire bytes of the keyframe `first` that a client needs for the same picture as of `whole`, which is all of it.
    fn first_bytes(&self, whole: &State, first: &StepOutput) -> Outcome<u64> {
        let mut empty = State::new(self.both.tables().surface.layout());
        if let (PointSource::SHARED, Some(state)) =
            (self.both.tables().surface.info().geometry, empty.as_surface_mut())
        {
            make_shared_geometry(self.both.world().scene(), self.both.tables().surface.info(), state)
                .map_err(Failure::input)?;
        }
        let Some(empty) = empty.as_surface() else { return Ok(0) };
        let buffer = self.look(&SceneView::new(self.both.world()))?;
        let picture = self.blend(whole, &buffer)?.image;
        let header = first.info.header_bytes as usize;
        let ends = first.info.sections.iter().scan(header, |end, section| {
            *end += section.wire_bytes as usize;
            Some(*end)
        });
        let ends: Vec<usize> = ends.collect();
        let limits = Limits::default().codec;
        let shows = |end: usize| -> Outcome<bool> {
            let seen = preview(empty, &first.body[..end], &limits).map_err(Failure::input)?;
            let Some(seen) = seen else { return Ok(false) };
            Ok(self.blend(&State::Surface(Box::new(seen.state)), &buffer)?.image == picture)
        };
        let (mut low, mut high) = (0, ends.len().saturating_sub(1));
        while low < high {
            let middle = usize::midpoint(low, high);
            if shows(ends[middle])? { high = middle } else { low = middle + 1 }
        }
        Ok((HEADER_BYTES + ends.get(low).copied().unwrap_or(header)) as u64)
    }

    fn seen(&self, truth: &AoImage, drawn: &Reconstruction) -> Outcome<Seen> {
        let comparison =
            Comparison::new(truth, &drawn.image).map_err(|error| Failure::new(Exit::System, error))?;
        Ok(Seen { frame: self.frame, comparison, unsupported: drawn.statistics.unsupported_share() })
    }

    fn write(&self, folder: &Path, truth: &AoImage, [paper, surface]: [&AoImage; 2]) -> Outcome {
        let [truth, paper, surface] = [truth, paper, surface].map(Picture::grey);
        let beside = Picture::side_by_side(&[truth.clone(), paper.clone(), surface.clone()])
            .map_err(|error| Failure::new(Exit::System, error))?;
        for (name, picture) in
            [("reference", truth), ("paper", paper), ("surface", surface), ("side-by-side", beside)]
        {
            let path = folder.join(format!("frame-{}.{name}.png", self.frame));
            let png = picture.to_png().map_err(|error| Failure::new(Exit::System, error))?;
            std::fs::write(&path, png).map_err(|error| Failure::writing(&path, &error))?;
        }
        Ok(())
    }
}
