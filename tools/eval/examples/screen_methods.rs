//! Draws every screen-space method beside the ray-traced reference:
//! `cargo run --release -p psao-eval --example screen_methods -- FOLDER [SCENE [TIME]]`.

mod stopwatch;

use std::path::PathBuf;
use std::sync::Arc;

use psao_eval::adapter::SceneView;
use psao_eval::metric::Comparison;
use psao_eval::reference::{PAPER_RAYS, reference};
use psao_eval::screen::Screen;
use psao_eval::sweep::screen_methods;
use psao_reconstruct::picture::Picture;
use psao_reconstruct::{Size, cast_view};
use psao_server::ao::AoSettings;
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;
use stopwatch::Stopwatch;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("which folder?")?);
    let name = arguments.next().unwrap_or_else(|| "colonnade".to_owned());
    let time: f64 = arguments.next().map_or(Ok(1.0), |time| time.parse())?;
    std::fs::create_dir_all(&folder)?;

    let scene = Arc::new(Scene::load(&name)?);
    let world = SceneBvh::new(&scene, &scene.pose(time));
    let view = SceneView::new(&world);
    let (camera, size) = (scene.camera(time), Size::new(480, 270)?);
    let radius = scene.ao_radius_m();
    let settings = AoSettings::default().with_rays(PAPER_RAYS).with_radius(radius);
    let truth = reference(&view, &cast_view(&view, &camera, size)?, &settings)?;
    let screen = Screen::new(&view, &camera, size, 48)?;
    std::fs::write(folder.join("reference.png"), Picture::grey(&truth).to_png()?)?;

    let clock = Stopwatch::start();
    for (number, method) in screen_methods(&settings)?.iter().enumerate() {
        let shaded = method.shade(&screen, &clock)?;
        let found = Comparison::new(&truth, &shaded.image)?;
        println!(
            "{:14} MAE {:.4}  bias {:+.4}  PSNR {:.2} dB  {:8.1} ms  {:6} KiB  {}",
            method.name(),
            found.mae,
            found.bias,
            found.psnr,
            shaded.micros() as f64 / 1e3,
            shaded.bytes / 1024,
            method.label(),
        );
        let beside = Picture::side_by_side(&[Picture::grey(&truth), Picture::grey(&shaded.image)])?;
        std::fs::write(folder.join(format!("{number:02}-{}.png", method.name())), beside.to_png()?)?;
    }
    Ok(())
}
