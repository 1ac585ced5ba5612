//! A frame of a stream as pictures: reconstructed, by rays, their difference, side by side.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use psao_codec::State;
use psao_codec::surface::Geometry;
use psao_eval::adapter::SceneView;
use psao_eval::metric::{Comparison, Lpips, MetricError, PerceptualFigures};
use psao_eval::reference::reference;
use psao_eval::sweep::ErrorFigures;
use psao_proto::SceneInfo;
use psao_proto::message::{self, CameraPose, PointSource};
use psao_reconstruct::picture::Picture;
use psao_reconstruct::reconstruct::{self, Reconstruction, SurfaceReconstructor};
use psao_reconstruct::{AoImage, GBuffer, Size, Statistics, cast_view};
use psao_server::ao::{AoSettings, Occlusion};
use psao_server::points::make_shared_geometry;
use psao_server::scene::{Edits, Scene};
use psao_server::world::SceneBvh;

use crate::args::SizeArg;
use crate::context::Stopwatch;
use crate::error::{Exit, Failure, Outcome};
use crate::output::target;

/// Differences are multiplied by this in the difference picture: a quarter of the range is full colour.
const GAIN: f32 = 4.0;

/// Opens the scene of a recording by its name or path, or by another path to the same files.
pub(crate) fn scene_of(info: &SceneInfo, elsewhere: Option<&str>) -> Outcome<Arc<Scene>> {
    let name = elsewhere.unwrap_or(info.source.as_str());
    let scene = Scene::load(name).map_err(|error| {
        Failure::input(format_args!("{error}; --scene says where the recorded scene is now"))
    })?;
    if scene.digest() != &info.digest && info.digest != [0; 32] {
        return Err(Failure::input(format_args!(
            "\"{name}\" is not the scene that was recorded (\"{}\"): its files have changed, or it is another one; \
             a picture would be wrong. --scene says where the recorded one is",
            info.name
        )));
    }
    Ok(Arc::new(scene))
}

/// Reconstructs the AO of every fragment from a state of either profile, for the points that its server keeps up to date.
pub(crate) fn blend(
    state: &State,
    info: &SceneInfo,
    buffer: &GBuffer,
    camera: &CameraPose,
) -> Outcome<Reconstruction> {
    match state {
        State::Paper(state) => reconstruct::cells(state, buffer),
        State::Surface(state) => {
            let quality = info.trace.map_or(0.0, |trace| trace.quality);
            let mut reconstructor = SurfaceReconstructor::new();
            reconstructor.set_camera(camera, quality);
            reconstructor.reconstruct(state, buffer)
        }
    }
    .map_err(Failure::input)
}

/// Points that a stream does not carry, made from its scene once.
#[derive(Default)]
pub(crate) struct SharedPoints(Vec<Arc<Geometry>>);

impl SharedPoints {
    /// Returns the state with its points; unchanged where the stream carries them.
    pub(crate) fn complete<'a>(
        &mut self,
        state: &'a State,
        scene: &Scene,
        info: &SceneInfo,
    ) -> Outcome<Cow<'a, State>> {
        if info.geometry != PointSource::SHARED {
            return Ok(Cow::Borrowed(state));
        }
        let mut whole = state.clone();
        let Some(surface) = whole.as_surface_mut() else { return Ok(Cow::Borrowed(state)) };
        if self.0.is_empty() {
            make_shared_geometry(scene, info, surface).map_err(Failure::input)?;
            self.0 = (0..).map_while(|set| surface.geometry(set).cloned()).collect();
        } else {
            for (set, geometry) in (0..).zip(&self.0) {
                surface.share_geometry(set, Arc::clone(geometry)).map_err(Failure::input)?;
            }
        }
        Ok(Cow::Owned(whole))
    }
}

/// A frame drawn by the client.
pub(crate) struct Drawn {
    pub(crate) image: AoImage,
    pub(crate) statistics: Statistics,
    /// Milliseconds of primary visibility, and of reconstruction.
    pub(crate) raster_ms: f64,
    pub(crate) reconstruct_ms: f64,
    pub(crate) reference: Option<Referenced>,
}

/// The same view by rays.
pub(crate) struct Referenced {
    pub(crate) image: AoImage,
    pub(crate) error: ErrorFigures,
    pub(crate) rays: u32,
    pub(crate) ms: f64,
}

/// What is drawn.
pub(crate) struct Shot<'a> {
    pub(crate) scene: &'a Arc<Scene>,
    pub(crate) info: &'a SceneInfo,
    pub(crate) state: &'a State,
    /// Those in force.
    pub(crate) edits: &'a Edits,
    pub(crate) time_s: f64,
    /// The scene's own camera at that time unless given.
    pub(crate) camera: Option<CameraPose>,
    pub(crate) size: SizeArg,
    /// Rays a pixel of the reference; `None` draws none.
    pub(crate) reference_rays: Option<u32>,
    /// For LPIPS.
    pub(crate) network: Option<&'a Lpips>,
}

impl Shot<'_> {
    /// Draws the frame. AO comes from the state alone; geometry from the scene, which a client has.
    pub(crate) fn draw(&self) -> Outcome<Drawn> {
        let size = Size::new(self.size.width, self.size.height).map_err(Failure::usage)?;
        let aspect = size.aspect();
        let camera = CameraPose { aspect, ..self.camera.unwrap_or_else(|| self.scene.camera(self.time_s)) };
        let mut pose = self.scene.pose(self.time_s);
        pose.apply(self.edits);
        let world = SceneBvh::new(self.scene, &pose);
        let view = SceneView::new(&world);
        let start = Stopwatch::start();
        let wrong = if self.camera.is_some() { Exit::Usage } else { Exit::Input };
        let buffer = cast_view(&view, &camera, size).map_err(|error| Failure::new(wrong, error))?;
        let raster_ms = start.millis();
        let start = Stopwatch::start();
        let drawn = blend(self.state, self.info, &buffer, &camera)?;
        let reconstruct_ms = start.millis();
        let mut result = Drawn {
            image: drawn.image,
            statistics: drawn.statistics,
            raster_ms,
            reconstruct_ms,
            reference: None,
        };
        if let Some(rays) = self.reference_rays {
            let start = Stopwatch::start();
            let image = reference(&view, &buffer, &self.settings(rays)?).map_err(Failure::reference)?;
            let ms = start.millis();
            let error =
                self.compare(&image, &result.image).map_err(|error| Failure::new(Exit::System, error))?;
            result.reference = Some(Referenced { image, error, rays, ms });
        }
        Ok(result)
    }

    /// Returns the errors, with the figures of `psao lab sweep`.
    fn compare(&self, truth: &AoImage, image: &AoImage) -> Result<ErrorFigures, MetricError> {
        let error = Comparison::new(truth, image)?;
        Ok(ErrorFigures::new(&error, &PerceptualFigures::new(truth, image, self.network)?))
    }

    /// Returns the stream's radius and falloff with another number of rays.
    fn settings(&self, rays: u32) -> Outcome<AoSettings> {
        let Some(trace) = self.info.trace else {
            return Err(Failure::input(
                "the stream does not say how its AO was traced: there is no reference for it",
            ));
        };
        let kind = match trace.occlusion {
            message::Occlusion::OBSCURANCE => Occlusion::Obscurance,
            message::Occlusion::BINARY => Occlusion::Binary,
            other => {
                return Err(Failure::input(format_args!(
                    "this version knows no reference for {other}; update it"
                )));
            }
        };
        Ok(AoSettings::default()
            .with_rays(rays)
            .with_radius(trace.radius_m)
            .with_kind(kind)
            .with_seed(trace.seed))
    }
}

/// Endings of the files that a reference adds: by rays, where the two differ, and all three side by side.
pub(crate) const BESIDE: [&str; 3] = ["reference.png", "difference.png", "side-by-side.png"];

impl Drawn {
    /// Writes `path`, and beside it the reference, the difference and both side by side where there is a reference.
    /// Returns the paths.
    pub(crate) fn write(&self, path: &Path) -> Outcome<Vec<PathBuf>> {
        let grey = Picture::grey(&self.image);
        let mut files = vec![(path.to_owned(), grey)];
        if let Some(by_rays) = &self.reference {
            let truth = Picture::grey(&by_rays.image);
            let drawing = |error| Failure::new(Exit::System, error);
            let difference = Picture::difference(&by_rays.image, &self.image, GAIN).map_err(drawing)?;
            let beside = Picture::side_by_side(&[files[0].1.clone(), truth.clone(), difference.clone()])
                .map_err(drawing)?;
            let beside = BESIDE.iter().zip([truth, difference, beside]);
            files.extend(beside.map(|(extension, picture)| (path.with_extension(extension), picture)));
        }
        for (path, picture) in &files {
            let png = picture.to_png().map_err(|error| Failure::new(Exit::System, error))?;
            target::write(path, &png)?;
        }
        Ok(files.into_iter().map(|(path, _)| path).collect())
    }
}
