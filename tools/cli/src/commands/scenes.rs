//! `psao scenes`: what is built in, and what each scene needs.

use psao_server_sim::scene::{Motion, Scene};
use serde::Serialize;

use crate::args::Format;
use crate::context::say;
use crate::error::{Exit, Failure, Outcome};
use crate::output::number;
use crate::output::table::Figures;

/// What is built in, and what each scene needs
///
/// With files, the same for each of them. What a scene does not need is left out of its stream.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Scene files (.toml, .gltf, .glb) or names to look at instead of the built-in scenes
    #[arg(value_name = "NAME|FILE")]
    scenes: Vec<String>,
    /// How to print: table, json or csv
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

#[derive(Serialize)]
struct Line {
    name: String,
    source: String,
    duration_s: f64,
    ao_radius_m: f32,
    triangles: usize,
    surface_m2: f64,
    instances: usize,
    rigid_movers: usize,
    deforming: usize,
    needs: Vec<&'static str>,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let names: Vec<String> = if args.scenes.is_empty() {
        Scene::builtin_names().iter().map(|&name| name.to_owned()).collect()
    } else {
        args.scenes.clone()
    };
    let mut lines = Vec::new();
    for name in &names {
        lines.push(line(&Scene::load(name).map_err(Failure::input)?));
    }
    match args.format {
        Format::Table => table(&lines),
        Format::Json => say(serde_json::to_string_pretty(&lines)
            .map_err(|error| Failure::new(Exit::System, format_args!("cannot write JSON: {error}")))?),
        Format::Csv => csv(&lines),
    }
}

fn line(scene: &Scene) -> Line {
    let moving =
        |motion: Motion| scene.instances().iter().filter(|instance| instance.motion() == motion).count();
    Line {
        name: scene.name().to_owned(),
        source: scene.source().to_owned(),
        duration_s: scene.duration_s(),
        ao_radius_m: scene.ao_radius_m(),
        triangles: scene.instances().iter().map(|instance| scene.rest(instance).triangles().len()).sum(),
        surface_m2: scene.instances().iter().map(|instance| scene.rest(instance).area_m2()).sum(),
        instances: scene.instances().len(),
        rigid_movers: moving(Motion::Rigid),
        deforming: moving(Motion::Deforming),
        needs: scene.needs().all().names().collect(),
    }
}

fn needs(line: &Line) -> String {
    if line.needs.is_empty() { "nothing".to_owned() } else { line.needs.join(", ") }
}

fn table(lines: &[Line]) -> Outcome {
    let mut table = Figures::new([
        "scene",
        "seconds",
        "radius m",
        "triangles",
        "surface m2",
        "instances",
        "rigid",
        "deforming",
        "needs",
    ])
    .words(&[8]);
    for line in lines {
        table.row([
            line.name.clone(),
            format!("{:.1}", line.duration_s),
            format!("{}", line.ao_radius_m),
            number::count(line.triangles as u64),
            format!("{:.1}", line.surface_m2),
            number::count(line.instances as u64),
            number::count(line.rigid_movers as u64),
            number::count(line.deforming as u64),
            needs(line),
        ]);
    }
    say(table)
}

fn csv(lines: &[Line]) -> Outcome {
    say("scene,seconds,radius_m,triangles,surface_m2,instances,rigid,deforming,needs")?;
    for line in lines {
        say(format_args!(
            "{},{},{},{},{:.3},{},{},{},{}",
            line.name,
            line.duration_s,
            line.ao_radius_m,
            line.triangles,
            line.surface_m2,
            line.instances,
            line.rigid_movers,
            line.deforming,
            line.needs.join("+"),
        ))?;
    }
    Ok(())
}
