//! What was found, as tables and as JSON.

use psao_proto::message::Needs;
use psao_server::clip::InstanceNeeds;
use psao_server::scene::{Motion, Scene};
use psao_server::server::{ServerMemory, ServerSettings};
use serde::Serialize;

use super::Args;
use super::measure::{Measured, PartSaved, Saved};
use super::rows::{Part, WORK, Work};
use crate::context::say;
use crate::error::{Exit, Failure, Outcome};
use crate::output::number;
use crate::output::spread::MedianRange;
use crate::output::table::Figures;

/// Everything that was found; `docs/needs-json.md` describes the fields.
#[derive(Serialize)]
pub(super) struct Document {
    schema: &'static str,
    scene: String,
    digest: String,
    frames: u32,
    fps: f32,
    rounds: u32,
    points: u32,
    points_per_m2: f32,
    min_points: u32,
    rays: u32,
    radius_m: f32,
    threshold: u8,
    seed: u64,
    all_visible: bool,
    state_hash: String,
    has: Vec<Has>,
    groups: Vec<Group>,
    frame: Frame,
    memory: Memory,
    left_out: Vec<Row>,
}

/// How much of the scene needs something.
#[derive(Serialize)]
struct Has {
    need: &'static str,
    instances: usize,
    points: u64,
}

/// Instances that need the same.
#[derive(Serialize)]
struct Group {
    motion: &'static str,
    needs: Vec<&'static str>,
    near_mover: bool,
    in_view: bool,
    instances: usize,
    points: u64,
    #[serde(skip)]
    key: InstanceNeeds,
}

/// A frame after the first, with everything left out.
#[derive(Serialize)]
struct Frame {
    first_bytes: u64,
    bytes: f64,
    traced: f64,
    rays: f64,
    ms: MedianRange,
}

/// Bytes that the server holds after the last frame.
#[derive(Serialize)]
struct Memory {
    structures: usize,
    points: usize,
    rays: usize,
    remembered: usize,
    stream: usize,
    total: usize,
}

/// Something that is left out.
#[derive(Serialize)]
struct Row {
    what: &'static str,
    why: &'static str,
    bytes_once: Option<i64>,
    bytes: Option<f64>,
    traced: Option<f64>,
    rays: Option<f64>,
    ms: Option<MedianRange>,
    frames_equal: Option<bool>,
    note: Option<String>,
}

impl Document {
    pub(super) fn new(
        args: &Args,
        scene: &Scene,
        settings: &ServerSettings,
        needs: &[InstanceNeeds],
        measured: &Measured,
    ) -> Self {
        let later = f64::from(args.frames - 1);
        let least = &measured.least;
        let work = WORK.iter().zip(&measured.work).map(|(work, saved)| Row::of_work(work, saved, later));
        let parts = Part::ALL.iter().zip(&measured.parts);
        let parts = parts.map(|(part, saved)| Row::of_part(*part, saved, later));
        Self {
            schema: "psao-needs/1",
            scene: scene.name().to_owned(),
            digest: scene.digest().iter().map(|byte| format!("{byte:02x}")).collect(),
            frames: args.frames,
            fps: settings.fps,
            rounds: args.rounds,
            points: measured.points,
            points_per_m2: settings.points.per_m2,
            min_points: settings.points.minimum,
            rays: settings.ao.rays,
            radius_m: settings.ao.radius,
            threshold: settings.threshold,
            seed: settings.ao.seed,
            all_visible: args.points.all_visible,
            state_hash: measured.hash.clone(),
            has: has(needs, &measured.instance_points),
            groups: groups(needs, &measured.instance_points),
            frame: Frame {
                first_bytes: least.first_bytes,
                bytes: least.bytes as f64 / later,
                traced: least.later.traced as f64 / later,
                rays: least.later.rays as f64 / later,
                ms: MedianRange::of(&measured.least_ms),
            },
            memory: Memory::of(&measured.memory),
            left_out: work.chain(parts).collect(),
        }
    }

    /// Returns an error where skipping something changed a frame.
    pub(super) fn verdict(&self) -> Outcome {
        let wrong = self.left_out.iter().filter(|row| row.frames_equal == Some(false));
        let wrong: Vec<&str> = wrong.map(|row| row.what).collect();
        if wrong.is_empty() {
            return Ok(());
        }
        let what = wrong.join(", ");
        Err(Failure::new(
            Exit::Check,
            format_args!("frames differ with and without: {what}; this is a fault of psao: report it"),
        ))
    }

    pub(super) fn print(&self) -> Outcome {
        let count = |value: f64| number::count(value.round() as u64);
        say(format_args!(
            "{}: {}; {} at {} Hz, {}; radius {} m, {} a point",
            self.scene,
            number::counted(self.points.into(), "point"),
            number::counted(self.frames.into(), "frame"),
            self.fps,
            number::counted(self.rounds.into(), "round"),
            self.radius_m,
            number::counted(self.rays.into(), "ray"),
        ))?;
        let mut table = Figures::new(["need", "instances", "points"]);
        for Has { need, instances, points } in &self.has {
            table.row([(*need).to_owned(), number::count(*instances as u64), number::count(*points)]);
        }
        say(table)?;
        let heads = ["motion", "needs", "near a mover", "in view", "instances", "points"];
        let mut table = Figures::new(heads).words(&[1, 2, 3]);
        for group in &self.groups {
            table.row([
                group.motion.to_owned(),
                if group.needs.is_empty() { "nothing".to_owned() } else { group.needs.join(", ") },
                yes(group.near_mover, "never"),
                yes(group.in_view, "never"),
                number::count(group.instances as u64),
                number::count(group.points),
            ]);
        }
        say(table)?;
        let Frame { first_bytes, bytes, traced, rays, ms } = &self.frame;
        say(format_args!(
            "First frame {}; then {bytes:.1} B, {} points traced, {} rays and {} ms a frame",
            number::bytes(*first_bytes),
            count(*traced),
            count(*rays),
            ms.text(),
        ))?;
        say(&self.memory)?;
        self.savings()?;
        say(format_args!("State hash after the last frame: {}", self.state_hash))
    }

    /// Prints what is left out, and what that saves.
    fn savings(&self) -> Outcome {
        let heads = [
            "left out",
            "why it can be",
            "B once",
            "B a frame",
            "points traced",
            "rays a frame",
            "ms a frame",
            "frames equal",
        ];
        let mut table = Figures::new(heads).words(&[1]);
        let figure = |value: Option<f64>| value.map_or("n/a".to_owned(), signed);
        for row in &self.left_out {
            table.row([
                row.what.to_owned(),
                row.why.to_owned(),
                figure(row.bytes_once.map(|bytes| bytes as f64)),
                figure(row.bytes),
                figure(row.traced),
                figure(row.rays),
                row.ms.map_or("n/a".to_owned(), MedianRange::signed_text),
                row.frames_equal.map_or("n/a".to_owned(), |equal| yes(equal, "NO")),
            ]);
        }
        say(table)?;
        for row in &self.left_out {
            if let Some(note) = &row.note {
                say(format_args!("{}: {note}", row.what))?;
            }
        }
        Ok(())
    }
}

impl Memory {
    fn of(memory: &ServerMemory) -> Self {
        let ServerMemory { structures, points, rays, remembered, stream } = *memory;
        Self { structures, points, rays, remembered, stream, total: memory.total() }
    }
}

impl std::fmt::Display for Memory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [total, structures, points, rays, remembered, stream] =
            [self.total, self.structures, self.points, self.rays, self.remembered, self.stream]
                .map(|bytes| number::bytes(bytes as u64));
        write!(
            f,
            "The server holds {total}, but for the scene: trees and posed geometry {structures}, points {points}, sets of \
             rays {rays}, remembered hits {remembered}, the stream {stream}"
        )
    }
}

impl Row {
    fn of_work(work: &Work, saved: &Saved, later: f64) -> Self {
        Self {
            what: work.what,
            why: work.why,
            bytes_once: saved.frames_equal.then_some(0),
            bytes: saved.frames_equal.then_some(0.0),
            traced: Some(saved.traced as f64 / later),
            rays: Some(saved.rays as f64 / later),
            ms: Some(MedianRange::of(&saved.ms)),
            frames_equal: Some(saved.frames_equal),
            note: None,
        }
    }

    fn of_part(part: Part, saved: &PartSaved, later: f64) -> Self {
        let note = match &saved.refused {
            Some(reason) => format!("n/a: {reason}"),
            None => part.note().to_owned(),
        };
        Self {
            what: part.what(),
            why: part.why(),
            bytes_once: saved.once,
            bytes: saved.later.map(|bytes| bytes as f64 / later),
            traced: None,
            rays: None,
            ms: None,
            frames_equal: None,
            note: Some(note),
        }
    }
}

fn yes(is: bool, otherwise: &str) -> String {
    (if is { "yes" } else { otherwise }).to_owned()
}

/// Returns a saving with its sign; one below a tenth is 0.
fn signed(value: f64) -> String {
    match value.abs() {
        size if size < 0.05 => "0".to_owned(),
        size if size < 100.0 => format!("{value:+.1}"),
        size => {
            let sign = if value < 0.0 { '-' } else { '+' };
            format!("{sign}{}", number::count(size.round() as u64))
        }
    }
}

/// Returns how much of the scene has each need, including needs that nothing has.
fn has(needs: &[InstanceNeeds], points: &[u32]) -> Vec<Has> {
    let sum = |need: &'static str, of: &dyn Fn(&InstanceNeeds) -> bool| {
        let found = needs.iter().zip(points).filter(|(needs, _)| of(needs));
        let (instances, points) =
            found.fold((0, 0), |(count, sum), (_, points)| (count + 1, sum + u64::from(*points)));
        Has { need, instances, points }
    };
    let all = Needs::from_bits_retain(u32::MAX);
    let named = all.names().map(|name| sum(name, &|needs| needs.needs.names().any(|need| need == name)));
    let more = [
        sum("motion of any kind", &|needs| needs.motion != Motion::Static),
        sum("a mover near", &|needs| needs.near_mover),
        sum("being in view", &|needs| needs.in_view),
    ];
    named.chain(more).collect()
}

/// Returns groups of instances that need the same, in the order of their first instance.
fn groups(needs: &[InstanceNeeds], points: &[u32]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (needs, points) in needs.iter().zip(points) {
        let found = groups.iter().position(|group| group.key == *needs).unwrap_or_else(|| {
            groups.push(Group {
                motion: needs.motion.name(),
                needs: needs.needs.names().collect(),
                near_mover: needs.near_mover,
                in_view: needs.in_view,
                instances: 0,
                points: 0,
                key: *needs,
            });
            groups.len() - 1
        });
        groups[found].instances += 1;
        groups[found].points += u64::from(*points);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_in_the_middle() {
        let of = |values: &[f64]| MedianRange::of(values).median;
        assert_eq!([of(&[]), of(&[3.0]), of(&[9.0, 1.0]), of(&[5.0, 1.0, -2.0])], [0.0, 3.0, 5.0, 1.0]);
        assert_eq!(MedianRange::of(&[4.0, -1.0, 2.0]), MedianRange { median: 2.0, least: -1.0, most: 4.0 });
    }

    #[test]
    fn savings_have_a_sign() {
        let texts = [0.0, 0.04, -3.26, 99.0, 1234.4, -1234.6].map(signed);
        assert_eq!(texts, ["0", "0", "-3.3", "+99.0", "+1,234", "-1,235"]);
    }
}
