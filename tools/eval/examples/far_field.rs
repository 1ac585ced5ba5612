//! Compares far-field obscurance and its mipmap method with rays through the same depth field, as in the tables and
//! figures of Timonen (2013): `cargo run --release -p psao-eval --example far_field -- FOLDER [SCENE [WIDTH [RAYS]]]`.

mod stopwatch;

use std::path::PathBuf;
use std::sync::Arc;

use psao_eval::adapter::SceneView;
use psao_eval::screen::{
    Falloff, FarField, FarFieldSettings, Mipmap, MipmapSettings, NearField, Screen, ScreenMethod, ScreenRays,
    Separation,
};
use psao_reconstruct::picture::Picture;
use psao_reconstruct::{AoImage, Size};
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;
use stopwatch::Stopwatch;

/// Radius in metres at which the falloff ends, and its rate.
const RADIUS: f32 = 3.0;
const FALLOFF: Falloff = Falloff::Exponential { decay: 3.0 };

/// A method with the settings' short name.
type Named = (&'static str, Box<dyn ScreenMethod>);

/// Returns every setting that the paper shows, and those that this crate adds.
fn methods() -> Result<Vec<Named>, Box<dyn std::error::Error>> {
    let base = || FarFieldSettings { radius: RADIUS, falloff: FALLOFF, ..FarFieldSettings::default() };
    let separate = |blur| FarFieldSettings { sectors: 18, separate: Some(Separation { blur }), ..base() };
    let settings = [
        ("8x2", FarFieldSettings { sectors: 8, ..base() }),
        ("16x1", FarFieldSettings { segments: 1, ..base() }),
        ("16x2", base()),
        ("8x4", FarFieldSettings { sectors: 8, segments: 4, ..base() }),
        ("32x2", FarFieldSettings { sectors: 32, ..base() }),
        ("16x2-b5", FarFieldSettings { interval: 5, ..base() }),
        ("16x2-b20", FarFieldSettings { interval: 20, ..base() }),
        ("16x2-near", FarFieldSettings { near: Some(NearField { growth: 1.5 }), ..base() }),
        ("16x2-jitter", FarFieldSettings { jitter: Some(1), ..base() }),
        ("16x2-midway", FarFieldSettings { midway: true, ..base() }),
        ("8x2-midway", FarFieldSettings { sectors: 8, midway: true, ..base() }),
        ("separate", separate(false)),
        ("separate-blur", separate(true)),
        ("separate-blur-midway", FarFieldSettings { midway: true, ..separate(true) }),
        ("far-alone", FarFieldSettings { near: None, ..base() }),
        ("thick", FarFieldSettings { thickness: Some(0.5), ..base() }),
        ("thick-jitter", FarFieldSettings { thickness: Some(0.5), jitter: Some(1), ..base() }),
    ];
    let mut methods: Vec<Named> = Vec::new();
    for (name, settings) in settings {
        methods.push((name, Box::new(FarField::new(settings)?)));
    }
    let mipmap = MipmapSettings { radius: RADIUS, falloff: FALLOFF, ..MipmapSettings::default() };
    methods.push(("mipmap", Box::new(Mipmap::new(mipmap)?)));
    Ok(methods)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("which folder?")?);
    let name = arguments.next().unwrap_or_else(|| "colonnade".to_owned());
    let width: u32 = arguments.next().map_or(Ok(480), |width| width.parse())?;
    let rays: u32 = arguments.next().map_or(Ok(256), |rays| rays.parse())?;
    std::fs::create_dir_all(&folder)?;

    let scene = Arc::new(Scene::load(&name)?);
    let world = SceneBvh::new(&scene, &scene.pose(1.0));
    // The guard band of the paper: a tenth.
    let inner = Size::new(width, width * 9 / 16)?;
    let screen = Screen::new(&SceneView::new(&world), &scene.camera(1.0), inner, width / 10)?;
    let clock = Stopwatch::start();
    let traced = |thickness| {
        let rays = ScreenRays { rays, thickness, ..ScreenRays::far(RADIUS, FALLOFF) };
        rays.shade(&screen, &clock).map(|shaded| shaded.image)
    };
    let (continuous, thick) = (traced(None)?, traced(Some(0.5))?);
    for (name, method) in methods()? {
        let reference = if name.starts_with("thick") { &thick } else { &continuous };
        let shaded = method.shade(&screen, &clock)?;
        let (average, right) = errors(reference, &shaded.image);
        let stages: Vec<String> = shaded
            .stages
            .iter()
            .map(|(stage, micros)| format!("{stage} {:.1}", *micros as f64 / 1e3))
            .collect();
        println!(
            "{name:20} e_A {average:5.2} %  e_<5% {right:5.1} %  ms: {}  {} KiB",
            stages.join(", "),
            shaded.bytes / 1024
        );
        let pictures = [
            Picture::grey(reference),
            Picture::grey(&shaded.image),
            Picture::difference(reference, &shaded.image, 5.0)?,
        ];
        std::fs::write(folder.join(format!("{name}.png")), Picture::side_by_side(&pictures)?.to_png()?)?;
    }
    Ok(())
}

/// Returns the average difference and the share of pixels within 5 % (section 8), in per cent.
fn errors(reference: &AoImage, found: &AoImage) -> (f64, f64) {
    let pairs = || reference.values().iter().zip(found.values());
    let count = pairs().count() as f64;
    let sum: f64 = pairs().map(|(a, b)| f64::from((a - b).abs())).sum();
    let right = pairs().filter(|(a, b)| (*a - *b).abs() < 0.05).count() as f64;
    (100.0 * sum / count, 100.0 * right / count)
}
