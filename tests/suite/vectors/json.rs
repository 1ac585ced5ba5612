//! What a vector's json says, written by hand so that it is the same on every machine and one can read it.

use std::fmt::Write;

use psao_codec::ContentError;
use psao_codec::envelope::{FrameError, FrameInfo, SectionTag};
use psao_codec::paper::State;
use psao_codec::surface::{self, SectionError, ValueError};

use super::Vector;
use super::scenes::Stream;
use super::stand::Stand;

/// A list, in one line.
pub(crate) fn list<T: ToString>(items: impl IntoIterator<Item = T>) -> String {
    let items: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    format!("[{}]", items.join(", "))
}

/// A list, each item in a line of its own.
pub(crate) fn lines(items: &[String]) -> String {
    if items.is_empty() { "[]".to_owned() } else { format!("[\n  {}\n]", items.join(",\n  ")) }
}

pub(crate) fn floats(values: &[f32]) -> String {
    list(values.iter().map(|value| format!("{value:?}")))
}

pub(super) fn vector(vector: &Vector, stand: &Stand, result: &Result<FrameInfo, FrameError>) -> String {
    let after = vector.after.as_ref().map_or("null".to_owned(), |name| format!("\"{name}\""));
    let mut out = format!("{{\n\"layout\": \"{}\",\n\"after\": {after},\n", vector.layout);
    match result {
        Err(error) => writeln!(out, "\"error\": \"{}\"", reason(error)).unwrap(),
        Ok(info) => {
            let (frame, time, hash) = (info.frame, info.time.micros(), info.hash);
            writeln!(out, "\"frame\": {frame},\n\"time\": {time},\n\"hash\": \"{hash}\",").unwrap();
            match stand {
                Stand::Paper(state) => paper(&mut out, state, vector.full),
                Stand::Surface(state) => on_surface(&mut out, state, vector.full),
            }
        }
    }
    out + "}\n"
}

/// Words without the zeros at their end.
fn words(words: &[u32]) -> String {
    let used = words.len() - words.iter().rev().take_while(|word| **word == 0).count();
    let words: Vec<String> = words[..used].iter().map(|word| format!("{word:08x}")).collect();
    words.join(" ")
}

fn paper(out: &mut String, state: &State, full: bool) {
    let mut poses = vec![];
    for (pose, at) in state.poses().iter().zip(0..) {
        let all: Vec<u32> =
            pose.translation.iter().chain(&pose.rotation).map(|axis| axis.to_bits()).collect();
        poses.push((at, all));
    }
    let identity = words(&[0, 0, 0, 0, 0, 0, 1.0_f32.to_bits()]);
    let listed = |name: &str, records: Vec<(u32, Vec<u32>)>, empty: &str| {
        let records = records.iter().map(|(at, all)| (at, words(all))).filter(|(_, words)| words != empty);
        lines(
            &records
                .map(|(at, words)| format!("{{\"{name}\": {at}, \"words\": \"{words}\"}}"))
                .collect::<Vec<_>>(),
        )
    };
    let buckets = state.buckets().iter().zip(0..).map(|(bucket, at)| (at, bucket.to_words().to_vec()));
    let cells = state.cells().iter().zip(0..).map(|(cell, at)| (at, cell.words().to_vec()));
    writeln!(out, "\"poses\": {},", listed("instance", poses, &identity)).unwrap();
    writeln!(out, "\"buckets\": {},", listed("bucket", buckets.collect(), "")).unwrap();
    write!(out, "\"cells\": {}", listed("cell", cells.collect(), "")).unwrap();
    if full {
        write!(out, ",\n\"points\": {}", lines(&points(state))).unwrap();
    }
    out.push('\n');
}

fn points(state: &State) -> Vec<String> {
    let mut points = vec![];
    for (layout, instance) in state.layout().instances().iter().zip(0..) {
        let [width, height, depth] = layout.grid.dims();
        let cells =
            (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
        for cell in cells {
            for point in
                state.lookup(instance, cell).iter().flat_map(|held| held.points(state.layout().format()))
            {
                let corner = layout.grid.corner(cell);
                let position: Vec<f32> =
                    (0..3).map(|axis| corner[axis] + point.frac[axis] * layout.grid.edge()).collect();
                points.push(format!(
                    "{{\"instance\": {instance}, \"cell\": {}, \"position\": {}, \"normal\": {}, \"ao\": {}}}",
                    list(cell),
                    floats(&position),
                    floats(&point.normal),
                    point.ao
                ));
            }
        }
    }
    points
}

fn on_surface(out: &mut String, state: &surface::State, full: bool) {
    let layout = state.layout();
    // What was shared did not come.
    let sets = (0..layout.sets().len() as u32).filter(|set| state.geometry(*set).is_some());
    let mut runs: Vec<(usize, usize)> = vec![];
    for instance in 0..layout.members().len() as u32 {
        let blocks = layout.blocks_of(instance);
        for block in blocks.clone().filter(|block| state.is_present(instance, block - blocks.start)) {
            match runs.last_mut() {
                Some((first, count)) if *first + *count == block => *count += 1,
                _ => runs.push((block, 1)),
            }
        }
    }
    writeln!(out, "\"sets\": {},", list(sets)).unwrap();
    let runs = runs.iter().map(|(first, count)| format!("[{first}, {count}]"));
    write!(out, "\"present\": {}", list(runs)).unwrap();
    if full {
        let mut values = String::new();
        for instance in 0..layout.members().len() as u32 {
            state.values(instance).iter().for_each(|value| write!(values, "{value:02x}").unwrap());
        }
        write!(out, ",\n\"values\": \"{values}\"").unwrap();
    }
    out.push('\n');
}

pub(super) fn layout(stream: &Stream) -> String {
    match stream {
        Stream::Paper { layout, .. } => {
            let instances: Vec<String> = layout
                .instances()
                .iter()
                .map(|instance| {
                    format!(
                        "{{\"origin\": {}, \"edge\": {:?}, \"dims\": {}, \"first_bucket\": {}, \"buckets\": {}, \"kernel_radius\": {:?}}}",
                        floats(&instance.grid.origin()),
                        instance.grid.edge(),
                        list(instance.grid.dims()),
                        instance.first_bucket,
                        instance.bucket_count,
                        instance.kernel_radius
                    )
                })
                .collect();
            format!(
                "{{\n\"profile\": \"paper\",\n\"packing\": {},\n\"cells\": {},\n\"instances\": {}\n}}\n",
                layout.format().packing().0,
                layout.cell_capacity(),
                lines(&instances)
            )
        }
        Stream::Surface { layout, geometry, shared, .. } => {
            let sets: Vec<String> =
                layout.sets().iter().zip(geometry).map(|(set, points)| one_set(set, points)).collect();
            let members = list(layout.members().iter().map(|member| member.set));
            format!(
                "{{\n\"profile\": \"surface\",\n\"shared\": {shared},\n\"members\": {members},\n\"sets\": {}\n}}\n",
                lines(&sets)
            )
        }
    }
}

/// A set of a layout, its points, and what the first of them are.
fn one_set(set: &surface::SetLayout, points: &surface::Geometry) -> String {
    let nodes = (0..points.len()).map(|point| {
        let [x, y, z] = points.node(point);
        format!("[{x}, {y}, {z}, {}, {}]", points.normal_code(point), points.chart(point))
    });
    let samples = (0..points.len().min(24)).map(|point| {
        format!(
            "{{\"position\": {}, \"normal\": {}}}",
            floats(&points.position(point)),
            floats(&points.normal(point))
        )
    });
    format!(
        "{{\"origin\": {}, \"step\": {:?}, \"extent\": {}, \"normal_bits\": {}, \"points\": {}, \"charts\": {}, \"levels\": {}, \"level_ends\": {}, \"kernel_radius\": {:?}, \"digest\": \"{:016x}\",\n  \"nodes\": {},\n  \"samples\": {}}}",
        floats(&set.origin),
        set.step,
        list(set.extent),
        set.normal_bits,
        set.points,
        set.charts,
        set.levels.count(),
        list(set.levels.ends()),
        set.kernel_radius,
        set.digest.0,
        list(nodes),
        list(samples)
    )
}

/// Every reason for which a vector is refused.
pub(super) const REASONS: [&str; 26] = [
    "block",
    "bucket",
    "cell",
    "changes",
    "checksum",
    "coder",
    "context",
    "geometry",
    "hash",
    "keyframe",
    "kind",
    "length",
    "offset",
    "order",
    "packing",
    "patch",
    "plain",
    "pose",
    "profile",
    "range",
    "records",
    "section",
    "trailing",
    "truncated",
    "values",
    "varint",
];

pub(super) fn reason(error: &FrameError) -> &'static str {
    match error {
        FrameError::TooLong { .. } | FrameError::RawLength { .. } | FrameError::BlockTooLarge { .. } => {
            "length"
        }
        FrameError::Truncated { .. } => "truncated",
        FrameError::Varint { .. } => "varint",
        FrameError::ProfileUnknown { .. } | FrameError::ProfileOther { .. } => "profile",
        FrameError::Packing { .. } | FrameError::PackingUnknown { .. } => "packing",
        FrameError::Kind { .. } => "kind",
        FrameError::SectionUnknown { .. }
        | FrameError::SectionOrder { .. }
        | FrameError::SectionMisplaced { .. }
        | FrameError::SectionBeside { .. } => "section",
        FrameError::Coder { .. } => "coder",
        FrameError::NoRecords { .. } | FrameError::TooManyRecords { .. } => "records",
        FrameError::Trailing { .. } => "trailing",
        FrameError::Checksum { .. } => "checksum",
        FrameError::Block { .. } => "block",
        FrameError::OffsetOrder { .. } | FrameError::OffsetRange { .. } => "offset",
        FrameError::Record { section: SectionTag::POSES, .. } => "pose",
        FrameError::Record { section: SectionTag::BUCKETS, .. } => "bucket",
        FrameError::Record { section: SectionTag::CELLS, .. } => "cell",
        FrameError::Content { section: SectionTag::GEOMETRY, .. } => "geometry",
        // Only the range coder's reader calls the field so: it stops as soon as the block cannot be whole.
        FrameError::Content {
            problem: ContentError::Surface(SectionError::Values(ValueError::Ends { field: "the values", .. })),
            ..
        } => "range",
        FrameError::Content { section: SectionTag::VALUES, .. } => "values",
        FrameError::Content { section: SectionTag::CHANGES, .. } => "changes",
        FrameError::Content { section: SectionTag::CONTEXT, .. } => "context",
        FrameError::Content { section: SectionTag::PATCH, .. } => "patch",
        FrameError::RangeLength { .. } => "range",
        FrameError::PlainLength { .. } => "plain",
        FrameError::NoKeyframe { .. } => "keyframe",
        FrameError::FrameOrder { .. } | FrameError::PatchBase { .. } => "order",
        FrameError::Hash { .. } => "hash",
        other => unreachable!("{other} has no word yet"),
    }
}
