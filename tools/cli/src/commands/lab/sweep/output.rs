//! What a run prints and writes.

use std::path::Path;
use std::sync::Arc;

use psao_eval::report::{Cost, Page, SceneSection, Thumbnail, best_by_budget, csv, table};
use psao_eval::sweep::{Record, RecordAtRadius, ReferenceRays};
use serde::Serialize;

use super::plan::{Plan, Sweep};
use super::preset::TableArg;
use super::store::Store;
use super::{Args, machine::Machine};
use crate::args::Format;
use crate::context::{say, to_json};
use crate::error::{Failure, Outcome};
use crate::output::number;
use crate::output::table::Figures;

/// `results.json`, and what `--format json` prints; `docs/evaluate-json.md` describes the fields.
#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    machine: &'a Machine,
    seconds: f64,
    width: u32,
    height: u32,
    guard: u32,
    picture_times_s: &'a [f64],
    reference_rays: u32,
    repeats: u32,
    warm_up: u32,
    min_points: u32,
    seed: u64,
    left_out: &'a [String],
    scenes: Vec<SceneOut<'a>>,
    records: Vec<RecordAtRadius<'a>>,
}

#[derive(Serialize)]
struct SceneOut<'a> {
    name: &'a str,
    digest: String,
    radius_m: f32,
    occlusion: String,
    reference: &'static str,
}

/// Prints and writes everything.
pub(super) fn write(args: &Args, sweep: &Sweep<'_>, plans: &[Plan<'_>], store: &Store) -> Outcome {
    let entries: Vec<Vec<RecordAtRadius<'_>>> = plans.iter().map(|plan| plan.entries(store)).collect();
    let all: Vec<RecordAtRadius<'_>> = entries.iter().flatten().copied().collect();
    let document = Document {
        schema: "psao-evaluate/1",
        machine: &sweep.machine,
        seconds: sweep.seconds,
        width: sweep.size.width(),
        height: sweep.size.height(),
        guard: sweep.guard,
        picture_times_s: plans.first().map_or(&[], |plan| &plan.times),
        reference_rays: args.reference_rays,
        repeats: args.repeats,
        warm_up: args.warm_up,
        min_points: args.min_points,
        seed: args.seed,
        left_out: &sweep.rivals.left_out,
        scenes: plans.iter().map(scene).collect(),
        records: all.clone(),
    };
    let json = to_json(&document)?;
    if let Some(folder) = &args.output {
        file(&folder.join("results.json"), &json)?;
        file(&folder.join("results.csv"), &csv(all.iter().copied()))?;
        file(&folder.join("report.html"), &page(args, sweep, plans, &entries, store).html())?;
    }
    match args.format.get() {
        Format::Json => return say(json),
        Format::Csv => return say(csv(all.iter().copied()).trim_end()),
        Format::Table => print(args, plans, &entries)?,
    }
    if store.unreadable > 0 {
        say(format_args!(
            "{} of an earlier run left out; what was there is measured again",
            number::counted(store.unreadable as u64, "damaged line")
        ))?;
    }
    Ok(())
}

fn file(path: &Path, text: &str) -> Outcome {
    std::fs::write(path, text).map_err(|error| Failure::writing(path, &error))
}

fn scene<'a>(plan: &Plan<'a>) -> SceneOut<'a> {
    SceneOut {
        name: plan.scene.name(),
        digest: plan.scene.digest().iter().map(|byte| format!("{byte:02x}")).collect(),
        radius_m: plan.reference.radius,
        occlusion: format!("{:?}", plan.reference.kind).to_lowercase(),
        reference: match plan.truth {
            ReferenceRays::Scene(_) => "scene",
            ReferenceRays::Screen(_) => "screen",
        },
    }
}

/// A table for each plan, or for each scene.
fn print(args: &Args, plans: &[Plan<'_>], entries: &[Vec<RecordAtRadius<'_>>]) -> Outcome {
    let together = args.table.is_some_and(TableArg::spans_radii);
    let one_table = |a: &Plan<'_>, b: &Plan<'_>| together && Arc::ptr_eq(a.scene, b.scene);
    let mut rest = entries;
    for plans in plans.chunk_by(one_table) {
        let Some(plan) = plans.first() else { continue };
        let (shown, later) = rest.split_at(plans.len());
        rest = later;
        let radii: Vec<String> = plans.iter().map(|plan| plan.reference.radius.to_string()).collect();
        say(format_args!(
            "{}: {} of {} pixels over {:.2} s, against {} rays of {} m a pixel{}",
            plan.scene.name(),
            number::counted(plan.times.len() as u64, "picture"),
            plan.sweep.size,
            plan.sweep.seconds,
            args.reference_rays,
            radii.join(", "),
            through(&plan.truth),
        ))?;
        let all: Vec<RecordAtRadius<'_>> = shown.iter().flatten().copied().collect();
        if let Some(table) = args.table {
            say(table.figures(&all, &plan.truth))?;
        } else {
            let (heads, rows) = table(&records(&all), false);
            let mut figures = Figures::of(&heads).words(&[1, 2]);
            rows.into_iter().for_each(|row| figures.row(row));
            say(figures)?;
        }
        if let Some(beside) = args.table.and_then(|table| table.beside(&all)) {
            say(beside)?;
        }
        if args.recommend {
            for (plan, entries) in plans.iter().zip(shown) {
                recommend(&plan.title(), &records(entries))?;
            }
        }
    }
    Ok(())
}

fn records<'a>(entries: &[RecordAtRadius<'a>]) -> Vec<&'a Record> {
    entries.iter().map(|entry| entry.record).collect()
}

/// Returns where the rays of references go, if not through the scene.
fn through(truth: &ReferenceRays) -> String {
    match truth {
        ReferenceRays::Scene(_) => String::new(),
        ReferenceRays::Screen(rays) => format!(" through the depth buffer, {}", rays.falloff.label()),
    }
}

/// Prints which setting to choose for which cost.
fn recommend(scene: &str, records: &[&Record]) -> Outcome {
    for (cost, unit) in [(Cost::MbitPerSecond, "Mbit/s"), (Cost::PictureMs, "ms a picture on the client")] {
        let steps = best_by_budget(records, cost);
        let Some(first) = steps.first() else { continue };
        say(format_args!(
            "{scene}: with less than {:.3} {unit}, nothing that was measured fits.",
            first.budget
        ))?;
        for (step, next) in steps.iter().zip(steps.iter().skip(1).map(Some).chain([None])) {
            let range = match next {
                Some(next) => format!("{:.3} to {:.3} {unit}", step.budget, next.budget),
                None => format!("{:.3} {unit} or more", step.budget),
            };
            let record = records[step.index];
            say(format_args!("  {range}: choose {} (e_A {:.4})", record.title(), step.mae))?;
        }
    }
    Ok(())
}

fn page<'a>(
    args: &Args,
    sweep: &Sweep<'_>,
    plans: &[Plan<'_>],
    entries: &[Vec<RecordAtRadius<'a>>],
    store: &Store,
) -> Page<'a> {
    let sections = plans.iter().zip(entries).map(|(plan, entries)| {
        let records = records(entries);
        let pictures = thumbnails(args.thumbnails, plan, &records, store);
        SceneSection { scene: plan.title(), records, pictures }
    });
    let grid = if args.sweeps_every_combination() {
        "Every combination of the settings was measured."
    } else {
        "One axis of the settings was swept at a time, the others kept at the first line's."
    };
    let runs = number::counted(args.repeats.into(), "run");
    let notes = vec![
        format!(
            "Clips of {:.2} s, pictures of {} pixels, compared with {} rays a pixel{}. {grid} Pictures are drawn with the \
             newest frame that began by their time.",
            sweep.seconds,
            sweep.size,
            args.reference_rays,
            plans.first().map(|plan| through(&plan.truth)).unwrap_or_default()
        ),
        "e_A is the mean absolute error, e_<5% the share of the pixels within 5 % of the range (higher is better). Of \
         PSNR and SSIM (11-tap Gaussian, sigma 1.5) more is better, of FLIP and LPIPS less. P99 and largest are of the \
         worst picture."
            .to_owned(),
        format!(
            "Server times are medians over the frames after the first state in {} of the clip. A picture's time is \
             the client's: applying a frame and reconstructing, decoding a frame of video and looking up, or all stages \
             of a screen-space method, {} a picture after {} to warm up. The G-buffer is drawn by the client in any case and is in no time. State is what a \
             client holds of the stream, written without compression; buffers are the G-buffer, or the screen and a \
             method's own working memory. The server's memory is what it holds after the last frame, but for the scene.",
            runs, runs, args.warm_up
        ),
    ];
    let left_out = sweep.rivals.left_out.iter().cloned();
    Page {
        title: "psao lab sweep".to_owned(),
        notes: notes.into_iter().chain(left_out).collect(),
        machine: sweep.machine.rows(),
        sections: sections.collect(),
    }
}

/// Returns the reference, then the best of each name beside its error, for at most `most` names.
fn thumbnails(most: Option<usize>, plan: &Plan<'_>, records: &[&Record], store: &Store) -> Vec<Thumbnail> {
    let mut found = Vec::new();
    let mut add = |pictures: &[(&str, &str)], caption: String| {
        let pngs: Vec<Vec<u8>> = pictures.iter().filter_map(|(key, what)| store.png(key, what)).collect();
        if !pngs.is_empty() {
            found.push(Thumbnail { caption, pngs });
        }
    };
    add(&[(&plan.reference_key, "reference")], format!("Reference: {} rays a pixel", plan.reference.rays));
    let mut shown: Vec<&Record> = Vec::new();
    for &record in records {
        match shown.iter_mut().find(|best| best.name == record.name) {
            Some(best) if record.error.mae < best.error.mae => *best = record,
            Some(_) => {}
            None => shown.push(record),
        }
    }
    if let Some(most) = most {
        let mut errors: Vec<f64> = shown.iter().map(|best| best.error.mae).collect();
        errors.sort_by(f64::total_cmp);
        let limit = errors.get(most).copied().unwrap_or(f64::INFINITY);
        shown.retain(|best| best.error.mae < limit);
    }
    for best in shown {
        add(
            &[(&best.key, "picture"), (&best.key, "error")],
            format!("{}: e_A {:.4}; its error: white none, black 20 % or more", best.title(), best.error.mae),
        );
    }
    found
}
