//! `psao scenes`: what is built in, and what each scene needs.

use psao_server::bvh::Bounds;
use psao_server::scene::{Geometry, InstanceId, Motion, Scene};
use serde::Serialize;

use crate::args::{Format, FormatArg};
use crate::context::{say, say_json};
use crate::error::{Failure, Outcome};
use crate::output::csv::Csv;
use crate::output::number;
use crate::output::table::Figures;

/// List the built-in scenes, or describe scene files
///
/// Lists the size of each scene, and the features that it needs from a stream: skinning, rigid motion and so on. A stream
/// leaves out what its scene does not need.
///
/// Below the table it says what was left out of a file or read in another way, such as lines, or materials with BLEND.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao scenes
  psao scenes --instances colonnade
  psao scenes my-scene.glb --format json")]
pub(crate) struct Args {
    /// Scene files (.toml, .gltf, .glb) or names to describe [default: all built-in scenes]
    #[arg(value_name = "NAME|FILE")]
    scenes: Vec<String>,
    /// List the instances of each scene: index, name, and place at the start
    #[arg(long)]
    instances: bool,
    #[command(flatten)]
    format: FormatArg,
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
    /// What was left out of the file or read in another way, one entry for each kind.
    report: Vec<String>,
}

#[derive(Serialize)]
struct InstanceLine {
    scene: String,
    instance: u32,
    name: String,
    motion: &'static str,
    triangles: usize,
    /// Frame at the start, local to world: metres, and a unit quaternion x, y, z, w.
    translation: [f32; 3],
    rotation: [f32; 4],
    /// Middle and size of it in the world at the start, metres.
    middle: [f32; 3],
    size: [f32; 3],
}

pub(crate) fn run(args: &Args) -> Outcome {
    let names: Vec<String> = if args.scenes.is_empty() {
        Scene::builtin_names().iter().map(|&name| name.to_owned()).collect()
    } else {
        args.scenes.clone()
    };
    let mut scenes = Vec::new();
    for name in &names {
        scenes.push(Scene::load(name).map_err(Failure::input)?);
    }
    if args.instances {
        return list(args.format.get(), &scenes.iter().flat_map(instances).collect::<Vec<_>>());
    }
    let lines: Vec<Line> = scenes.iter().map(line).collect();
    match args.format.get() {
        Format::Table => table(&lines),
        Format::Json => say_json(&lines),
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
        report: scene.report().lines(),
    }
}

fn instances(scene: &Scene) -> Vec<InstanceLine> {
    let pose = scene.pose(0.0);
    let mut geometry = Geometry::default();
    let lines = (0..).zip(scene.instances()).zip(pose.instances()).map(|((index, instance), at)| {
        scene.local_geometry(InstanceId(index), &pose, &mut geometry);
        let bounds = Bounds::around(geometry.positions().iter().map(|&local| at.frame().point(local)));
        InstanceLine {
            scene: scene.name().to_owned(),
            instance: index,
            name: instance.name().to_owned(),
            motion: instance.motion().name(),
            triangles: scene.rest(instance).triangles().len(),
            translation: at.frame().translation.to_array(),
            rotation: at.frame().rotation.to_array(),
            middle: ((bounds.min() + bounds.max()) * 0.5).to_array(),
            size: bounds.size().to_array(),
        }
    });
    lines.collect()
}

fn list(format: Format, lines: &[InstanceLine]) -> Outcome {
    let join = |numbers: &[f32], digits: usize| {
        numbers.iter().map(|number| format!("{number:.digits$}")).collect::<Vec<_>>().join(",")
    };
    match format {
        Format::Json => say_json(&lines),
        Format::Csv => {
            let heads = ["scene", "instance", "name", "motion", "triangles"];
            let mut csv = Csv::new(heads.into_iter().chain(["x", "y", "z", "qx", "qy", "qz", "qw"]))?;
            for line in lines {
                let InstanceLine { scene, instance, name, motion, triangles, .. } = line;
                let first = [scene.clone(), instance.to_string(), name.clone(), (*motion).to_owned()];
                let place =
                    line.translation.iter().chain(&line.rotation).map(|number| format!("{number:.6}"));
                csv.row(first.into_iter().chain([triangles.to_string()]).chain(place))?;
            }
            csv.finish()
        }
        Format::Table => {
            let heads = [
                "instance",
                "name",
                "motion",
                "triangles",
                "at x,y,z",
                "turned x,y,z,w",
                "middle",
                "size m",
                "scene",
            ];
            let mut table = Figures::new(heads).words(&[1, 2, 8]);
            for line in lines {
                table.row([
                    line.instance.to_string(),
                    line.name.clone(),
                    line.motion.to_owned(),
                    number::count(line.triangles as u64),
                    join(&line.translation, 2),
                    join(&line.rotation, 3),
                    join(&line.middle, 2),
                    join(&line.size, 2),
                    line.scene.clone(),
                ]);
            }
            say(table)
        }
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
    say(table)?;
    for line in lines {
        line.report.iter().try_for_each(|change| say(format_args!("{}: {change}", line.name)))?;
    }
    Ok(())
}

fn csv(lines: &[Line]) -> Outcome {
    let heads = "scene,seconds,radius_m,triangles,surface_m2,instances,rigid,deforming,needs,report";
    let mut csv = Csv::new(heads.split(','))?;
    for line in lines {
        csv.row([
            line.name.clone(),
            line.duration_s.to_string(),
            line.ao_radius_m.to_string(),
            line.triangles.to_string(),
            format!("{:.3}", line.surface_m2),
            line.instances.to_string(),
            line.rigid_movers.to_string(),
            line.deforming.to_string(),
            line.needs.join("+"),
            line.report.join("; "),
        ])?;
    }
    csv.finish()
}
