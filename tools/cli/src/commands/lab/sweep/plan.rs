//! What is to be measured, and the digests by which it is found again.

use std::fmt::Debug;
use std::sync::Arc;

use psao_eval::screen::{Falloff, ScreenMethod, ScreenRays};
use psao_eval::sweep::{
    CLOUD_VIDEO, CloudSettings, RecordAtRadius, ReferenceRays, Setting, SettingGrid, TEXTURE_SPACE,
    far_field_methods, picture_times, pyramid_methods, reach_px, screen_methods,
};
use psao_eval::texture::TextureSettings;
use psao_reconstruct::Size;
use psao_server::ao::{AoSettings, Occlusion};
use psao_server::scene::Scene;
use psao_server::server::ServerSettings;

use super::machine::Machine;
use super::preset::TableArg;
use super::store::Store;
use super::video::{Encoder, Ffmpeg, Video, missing};
use super::{Args, AxisArgs, VideoArgs};
use crate::error::{Exit, Failure, Outcome};

/// What is the same for all scenes.
pub(super) struct Sweep<'a> {
    pub(super) args: &'a Args,
    pub(super) settings: Vec<Setting>,
    pub(super) rivals: VideoRivals,
    /// Names of screen-space methods; `None` for all.
    methods: Option<Vec<String>>,
    pub(super) size: Size,
    pub(super) guard: u32,
    pub(super) seconds: f64,
    /// Pictures lie on its frames.
    rate: f64,
    pub(super) machine: Machine,
    /// Digest of the weights of LPIPS.
    weights: Option<String>,
}

/// What is measured of methods that send video.
#[derive(Default)]
pub(super) struct VideoRivals {
    textures: Vec<(TextureSettings, Video)>,
    clouds: Vec<(CloudSettings, Video)>,
    /// The program that codes it.
    program: Option<String>,
    /// What should have been measured and cannot be, in words.
    pub(super) left_out: Vec<String>,
}

/// A scene at one radius.
pub(super) struct Plan<'a> {
    pub(super) sweep: &'a Sweep<'a>,
    pub(super) scene: &'a Arc<Scene>,
    pub(super) base: ServerSettings,
    pub(super) reference: AoSettings,
    /// Whether it is the only radius.
    alone: bool,
    /// Its radius in pixels, where methods are chosen by it.
    reach_px: Option<f32>,
    pub(super) truth: ReferenceRays,
    pub(super) times: Vec<f64>,
    /// With their keys, in the order of tables.
    pub(super) jobs: Vec<(String, Job)>,
    /// By which the reference picture is kept.
    pub(super) reference_key: String,
}

/// One thing to measure.
pub(super) enum Job {
    Stream(Setting),
    Texture(TextureSettings, Video),
    Cloud(CloudSettings, Video),
    Method(Box<dyn ScreenMethod>),
}

impl<'a> Sweep<'a> {
    pub(super) fn new(args: &'a Args, size: Size, weights: Option<&[u8]>) -> Outcome<Self> {
        let grid = args.axes.or(args.table.map_or_else(AxisArgs::usual, TableArg::axes)).grid();
        let streams = !args.no_streams && args.table.is_none_or(TableArg::has_streams);
        let settings = match (streams, args.sweeps_every_combination()) {
            (false, _) => Vec::new(),
            (true, true) => grid.full(),
            (true, false) => grid.one_at_a_time(),
        };
        let own = args.table.and_then(TableArg::methods);
        let mut methods = match args.methods.as_slice() {
            [] => own.map(|names| names.iter().map(|&name| name.to_owned()).collect()),
            asked => names(asked)?,
        };
        let servers = video_servers(&grid, args.sweeps_every_combination());
        let rivals = VideoRivals::new(args, &mut methods, &servers)?;
        let machine = Machine { video: rivals.program.clone(), ..Machine::here() };
        let rate = f64::from(grid.fastest());
        if !(rate > 0.0 && rate <= 1_000.0) {
            return Err(Failure::usage(format_args!(
                "--fps {rate}: frames a second are above 0 and at most 1000"
            )));
        }
        if let Some(again) = (1..args.radius.len()).find(|&at| args.radius[..at].contains(&args.radius[at])) {
            return Err(Failure::usage(format_args!("--radius has {} twice", args.radius[again])));
        }
        Ok(Self {
            args,
            settings,
            rivals,
            methods,
            size,
            guard: args.guard.unwrap_or(size.width() / 10),
            seconds: f64::from(args.frames) / rate,
            rate,
            machine,
            weights: weights.map(|bytes| blake3::hash(bytes).to_hex().to_string()),
        })
    }

    /// Returns a plan for each radius of a scene.
    pub(super) fn plans(&'a self, scene: &'a Arc<Scene>) -> Vec<Outcome<Plan<'a>>> {
        let own = [scene.ao_radius_m()];
        let radii = match self.args.radius.as_slice() {
            [] => self.args.table.and_then(TableArg::radii_m).unwrap_or(&own),
            given => given,
        };
        radii.iter().map(|&radius| Plan::new(self, scene, radius, radii)).collect()
    }

    /// Returns the digest of a scene and everything else that the figures depend on.
    fn key(&self, scene: &Scene, truth: &ReferenceRays, what: &str) -> String {
        let args = self.args;
        let parts = format!(
            "psao-evaluate/1 {} {:?} {what} {:?} {} {} {} {:?} {truth:?} {} {} {} {:?}",
            env!("CARGO_PKG_VERSION"),
            scene.digest(),
            self.size,
            self.guard,
            self.seconds,
            self.rate,
            picture_times(self.seconds, self.rate, args.pictures),
            args.min_points,
            args.repeats,
            args.warm_up,
            (&self.weights, &self.machine.cpu, self.machine.threads, self.machine.build),
        );
        blake3::hash(parts.as_bytes()).to_hex()[..32].to_owned()
    }
}

/// Returns rays, rates and late cameras of the servers that send video. Unless every combination is swept, only the
/// camera differs.
fn video_servers(grid: &SettingGrid, every: bool) -> Vec<CloudSettings> {
    let Setting { rays, fps, camera_lag_ms, .. } = grid.centre();
    let rates = if every { grid.fps.clone() } else { vec![fps] };
    let mut lags = vec![camera_lag_ms];
    for &lag in &grid.camera_lag_ms {
        if !lags.contains(&lag) {
            lags.push(lag);
        }
    }
    let of_rate =
        |&fps: &f32| lags.iter().map(move |&camera_lag_ms| CloudSettings { rays, fps, camera_lag_ms });
    rates.iter().flat_map(of_rate).collect()
}

impl VideoRivals {
    /// Takes the methods that send video out of the names. Settings out of range are an error on any machine. A missing
    /// video coder is an error where a method was asked for by name, and else a note.
    fn new(args: &Args, methods: &mut Option<Vec<String>>, servers: &[CloudSettings]) -> Outcome<Self> {
        let mut take = |name: &str| match methods {
            Some(names) => {
                let wanted = names.iter().any(|found| found == name);
                names.retain(|found| found != name);
                wanted
            }
            None => args.table.is_none() && !args.no_streams,
        };
        let (texture, cloud) = (take(TEXTURE_SPACE), take(CLOUD_VIDEO));
        let videos = args.video.videos()?;
        if !texture && !cloud {
            return Ok(Self::default());
        }
        let textures = if texture { args.video.textures(servers)? } else { Vec::new() };
        let ffmpeg = Ffmpeg::find();
        let mut rivals = Self { program: ffmpeg.as_ref().map(ToString::to_string), ..Self::default() };
        let mut found = Vec::new();
        for (encoder, crf) in videos {
            match ffmpeg.as_ref().and_then(|ffmpeg| ffmpeg.video(encoder, crf)) {
                Some(video) => found.push(video),
                None => rivals.leave_out(args, encoder, [(texture, TEXTURE_SPACE), (cloud, CLOUD_VIDEO)])?,
            }
        }
        // With another camera, only the first of the other settings is measured.
        let first_lag = servers.first().map_or(0, |server| server.camera_lag_ms);
        let every = args.sweeps_every_combination();
        let of = |lag: u32, number: usize| every || lag == first_lag || number == 0;
        for (number, settings) in &textures {
            let videos =
                found.iter().enumerate().filter(|&(video, _)| of(settings.camera_lag_ms, *number + video));
            rivals.textures.extend(videos.map(|(_, &video)| (*settings, video)));
        }
        for server in servers.iter().filter(|_| cloud) {
            let videos = found.iter().enumerate().filter(|&(video, _)| of(server.camera_lag_ms, video));
            rivals.clouds.extend(videos.map(|(_, &video)| (*server, video)));
        }
        Ok(rivals)
    }

    /// Notes the wanted methods that lack an encoder, or fails for one that was asked for by name.
    fn leave_out(&mut self, args: &Args, encoder: Encoder, methods: [(bool, &str); 2]) -> Outcome {
        for (_, name) in methods.into_iter().filter(|(wanted, _)| *wanted) {
            if args.methods.iter().any(|asked| asked == name) {
                return Err(Failure::new(Exit::System, format_args!("{name}: {}", missing(encoder))));
            }
            let note = format!("{name} is left out: {}", missing(encoder));
            if !self.left_out.contains(&note) {
                self.left_out.push(note);
            }
        }
        Ok(())
    }
}

impl VideoArgs {
    /// Returns every encoder at every rate factor.
    fn videos(&self) -> Outcome<Vec<(Encoder, u8)>> {
        let pairs = self.video.iter().flat_map(|&encoder| self.crf.iter().map(move |&crf| (encoder, crf)));
        let mut all: Vec<(Encoder, u8)> = Vec::new();
        for pair in pairs {
            if !all.contains(&pair) {
                all.push(pair);
            }
        }
        match all.iter().find(|(encoder, crf)| *crf > encoder.most()) {
            Some((encoder, crf)) => Err(Failure::usage(format_args!(
                "--crf {crf}: {} takes 0 to {}",
                encoder.name(),
                encoder.most()
            ))),
            None => Ok(all),
        }
    }

    /// Returns the settings of texture-space for each server, with the number of their divisor.
    fn textures(&self, servers: &[CloudSettings]) -> Outcome<Vec<(usize, TextureSettings)>> {
        let of_server = |server: &CloudSettings| {
            let CloudSettings { rays, fps, camera_lag_ms } = *server;
            let settings = move |&divisor: &u32| TextureSettings {
                camera_lag_ms,
                ..TextureSettings::new(divisor, rays, fps)
            };
            self.atlas.iter().map(settings).enumerate()
        };
        let all: Vec<_> = servers.iter().flat_map(of_server).collect();
        all.iter().try_for_each(|(_, settings)| settings.validate()).map_err(Failure::usage)?;
        Ok(all)
    }
}

/// `--methods`: `None` for all.
fn names(asked: &[String]) -> Outcome<Option<Vec<String>>> {
    match asked {
        [one] if one == "all" => Ok(None),
        [one] if one == "none" => Ok(Some(Vec::new())),
        names if names.iter().any(|name| name == "all" || name == "none") => {
            Err(Failure::usage("--methods takes all, none, or names, not both"))
        }
        names => Ok(Some(names.to_vec())),
    }
}

impl<'a> Plan<'a> {
    /// At `radius`, which is one of `radii`.
    fn new(sweep: &'a Sweep<'a>, scene: &'a Arc<Scene>, radius: f32, radii: &[f32]) -> Outcome<Self> {
        let args = sweep.args;
        let kind = args.occlusion.into();
        let reference = AoSettings::default()
            .with_rays(args.reference_rays)
            .with_radius(radius)
            .with_kind(kind)
            .with_seed(args.seed);
        reference.validate().map_err(Failure::usage)?;
        let far = args.table == Some(TableArg::FarField);
        let truth = if far {
            ReferenceRays::Screen(far_reference(&reference))
        } else {
            ReferenceRays::Scene(reference)
        };
        let times = picture_times(sweep.seconds, sweep.rate, args.pictures);
        let mut reach = None;
        let methods = match &truth {
            ReferenceRays::Scene(ao) if args.table == Some(TableArg::PyramidHbao) => {
                let smallest = radii.iter().copied().fold(radius, f32::min);
                let pixels = reach_px(scene, &times, sweep.size, radius).map_err(super::refused)?;
                pyramid_methods(ao, smallest, *reach.insert(pixels)).map_err(|error| {
                    Failure::usage(format_args!("a radius of {radius} m beside one of {smallest} m: {error}"))
                })
            }
            ReferenceRays::Scene(ao) => screen_methods(ao).map_err(Failure::usage),
            ReferenceRays::Screen(rays) => far_field_methods(rays).map_err(Failure::usage),
        };
        let usual = ServerSettings::default();
        let base = usual
            .with_points(usual.points.with_minimum(args.min_points).with_seed(args.seed))
            .with_ao(reference.with_rays(usual.ao.rays));
        let mut jobs = Vec::new();
        for setting in &sweep.settings {
            setting.server(base).validate().map_err(Failure::usage)?;
            let key = sweep.key(scene, &truth, &format!("{setting:?}"));
            jobs.push((key, Job::Stream(*setting)));
        }
        let video_key = |settings: &dyn Debug, video: &Video| {
            sweep.key(scene, &truth, &format!("{settings:?} {video:?} {:?}", sweep.machine.video))
        };
        for (settings, video) in &sweep.rivals.textures {
            jobs.push((video_key(settings, video), Job::Texture(*settings, *video)));
        }
        for (settings, video) in &sweep.rivals.clouds {
            jobs.push((video_key(settings, video), Job::Cloud(*settings, *video)));
        }
        for method in chosen(methods?, sweep.methods.as_deref())? {
            let what = format!("{} {}", method.name(), method.label());
            jobs.push((sweep.key(scene, &truth, &what), Job::Method(method)));
        }
        if jobs.is_empty() {
            return Err(Failure::usage("nothing to measure: neither streams nor methods were asked for"));
        }
        Ok(Self {
            sweep,
            scene,
            base,
            times,
            reference_key: sweep.key(scene, &truth, "reference"),
            reference,
            alone: radii.len() == 1,
            reach_px: reach,
            truth,
            jobs,
        })
    }
}

impl Plan<'_> {
    /// Returns the records that have been measured, in the order of tables.
    pub(super) fn entries<'s>(&self, store: &'s Store) -> Vec<RecordAtRadius<'s>> {
        let entry = |(key, job): &(String, Job)| {
            let sampling = if let Job::Method(method) = job { method.sampling() } else { None };
            let (radius_m, reach_px) = (self.reference.radius, self.reach_px);
            Some(RecordAtRadius { record: store.record(key)?, radius_m, reach_px, sampling })
        };
        self.jobs.iter().filter_map(entry).collect()
    }

    /// Returns the name of the scene, with the radius where there are several.
    pub(super) fn title(&self) -> String {
        let name = self.scene.name();
        if self.alone { name.to_owned() } else { format!("{name}, R = {} m", self.reference.radius) }
    }
}

/// The reference of far-field obscurance, with an exponential falloff as in its paper where rays are weighted at all.
fn far_reference(ao: &AoSettings) -> ScreenRays {
    let falloff = match ao.kind {
        Occlusion::Obscurance => Falloff::Exponential { decay: 3.0 },
        Occlusion::Binary => Falloff::Binary,
    };
    ScreenRays { rays: ao.rays, seed: ao.seed, ..ScreenRays::far(ao.radius, falloff) }
}

/// Returns the methods of these names.
fn chosen(
    methods: Vec<Box<dyn ScreenMethod>>,
    names: Option<&[String]>,
) -> Outcome<Vec<Box<dyn ScreenMethod>>> {
    let Some(names) = names else { return Ok(methods) };
    if let Some(unknown) = names.iter().find(|name| !methods.iter().any(|method| method.name() == **name)) {
        let mut known: Vec<&str> = methods.iter().map(|method| method.name()).collect();
        known.dedup();
        known.extend([TEXTURE_SPACE, CLOUD_VIDEO]);
        return Err(Failure::usage(format_args!(
            "no method is called \"{unknown}\"; there are: {}",
            known.join(", ")
        )));
    }
    Ok(methods.into_iter().filter(|method| names.iter().any(|name| name == method.name())).collect())
}
