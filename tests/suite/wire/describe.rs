//! JSON descriptions of frames and recordings.

use psao_proto::message::{
    Accept, Ack, Auth, Budget, Close, Edit, EditAction, Gap, Hello, InstanceEntry, MemberEntry, Message,
    MessageError, PayloadError, PeerLimits, Ping, Pong, Reject, Report, Request, Scene, SceneHeader,
    SetEntry, StageTime, Stamp, View,
};
use psao_proto::recording::{DamageKind, IndexKind, Reader, ReaderError, StoredIndex, Summary, repair};
use psao_proto::{FrameHeader, FrameType, Framer, Limits, WireFrameError};

use super::object::{Object, hex};
use crate::vectors::json::{floats, lines, list};

/// Every reason for refusing a frame.
pub(super) const REASONS: [&str; 11] = [
    "bound",
    "checksum",
    "choice",
    "ended",
    "extra",
    "flags",
    "length",
    "magic",
    "unfinished",
    "utf-8",
    "value",
];

/// Returns the first frame in `bytes`, given to a framer in pieces of `size` bytes.
fn split(bytes: &[u8], size: usize) -> Result<(FrameHeader, Vec<u8>), &'static str> {
    let mut framer = Framer::new(Limits::default());
    for piece in bytes.chunks(size) {
        framer.push(piece);
        match framer.next_frame() {
            Ok(None) => {}
            Ok(Some(frame)) => {
                assert_eq!(frame.bytes.len(), bytes.len(), "a vector has one frame");
                return Ok((frame.header, frame.payload().to_vec()));
            }
            Err(error) => {
                return Err(match error.error {
                    WireFrameError::Magic { .. } => "magic",
                    WireFrameError::Flags { .. } => "flags",
                    WireFrameError::TooLong { .. } => "length",
                    WireFrameError::Checksum { .. } => "checksum",
                    other => unreachable!("{other} has no word yet"),
                });
            }
        }
    }
    Err("unfinished")
}

/// Returns the header of the frame in `bytes` and the JSON of its payload.
///
/// # Errors
/// One of [`REASONS`].
pub(super) fn content(bytes: &[u8]) -> Result<(FrameHeader, (&'static str, String)), &'static str> {
    let whole = split(bytes, usize::MAX);
    assert_eq!(split(bytes, 1), whole, "a frame in pieces is another one");
    let (header, payload) = whole?;
    let message = message(header.kind, &payload).map_err(|error| reason(&error))?;
    let content = match (message, header.kind) {
        (Some(message), _) => ("message", message.lines()),
        (None, FrameType::KEYFRAME | FrameType::UPDATE) => ("body", format!("\"{}\"", hex(&payload))),
        (None, _) => ("payload", format!("\"{}\"", hex(&payload))),
    };
    Ok((header, content))
}

pub(super) fn frame(bytes: &[u8]) -> String {
    let object = match content(bytes) {
        Err(word) => Object::default().text("error", word),
        Ok((header, (name, content))) => Object::default()
            .with("type", header.kind.0)
            .with("group", header.group)
            .with("sequence", header.sequence)
            .with(name, content),
    };
    object.file()
}

fn reason(error: &MessageError) -> &'static str {
    match error {
        MessageError::Malformed { reason, .. } => match reason {
            PayloadError::Ended => "ended",
            PayloadError::TooLong => "bound",
            PayloadError::Variant(_) => "choice",
            PayloadError::Utf8 => "utf-8",
            _ => unreachable!("{error} has no word yet"),
        },
        MessageError::Extra { .. } => "extra",
        MessageError::Invalid { field: "entries" | "stages" | "token", .. } => "bound",
        MessageError::Invalid { .. } => "value",
        other => unreachable!("{other} has no word yet"),
    }
}

/// Returns the fields of a message; `None` for a frame type without a message.
fn message(kind: FrameType, payload: &[u8]) -> Result<Option<Object>, MessageError> {
    let start = Object::default;
    Ok(Some(match kind {
        FrameType::HELLO => {
            let Hello { oldest, newest, profiles, coders, limits: takes, name } = read(payload)?;
            let versions = start().with("oldest", oldest).with("newest", newest);
            let sets = versions.with("profiles", profiles.0).with("coders", coders.0);
            sets.with("limits", limits(&takes)).text("name", name.as_str())
        }
        FrameType::ACCEPT => {
            let Accept { version, profile, limits: takes, name } = read(payload)?;
            let ids = start().with("version", version).with("profile", profile.0);
            ids.with("limits", limits(&takes)).text("name", name.as_str())
        }
        FrameType::REJECT => {
            let Reject { code, text } = read(payload)?;
            start().with("code", code.0).text("text", text.as_str())
        }
        FrameType::SCENE => scene(&read(payload)?),
        FrameType::VIEW => {
            let View { camera } = read(payload)?;
            let places = start().with("eye", floats(&camera.eye)).with("target", floats(&camera.target));
            let places = places.with("up", floats(&camera.up));
            places.float("fov_y_deg", camera.fov_y_deg).float("aspect", camera.aspect)
        }
        FrameType::EDIT => edit(&read(payload)?),
        FrameType::REQUEST => match read(payload)? {
            Request::Keyframe { reason } => start().with("choice", 0).with("reason", reason.0),
            Request::Stamps => start().with("choice", 1),
            Request::Datagrams { bytes } => start().with("choice", 2).with("bytes", bytes),
        },
        FrameType::REPORT => report(&read(payload)?),
        FrameType::CLOSE => {
            let Close { code, text } = read(payload)?;
            start().with("code", code.0).text("text", text.as_str())
        }
        FrameType::ACK => ack(&read(payload)?),
        FrameType::AUTH => {
            // A token is not readable through its type, so it is taken from the payload written back.
            let payload = read::<Auth>(payload)?.to_payload()?;
            start().hex("token", &payload[8..])
        }
        FrameType::PING => start().with("sent", read::<Ping>(payload)?.sent.0),
        FrameType::PONG => {
            let Pong { sent, received, replied } = read(payload)?;
            start().with("sent", sent.0).with("received", received.0).with("replied", replied.0)
        }
        FrameType::STAMP => {
            let Stamp { frame, captured, sent } = read(payload)?;
            start().with("frame", frame).with("captured", captured.0).with("sent", sent.0)
        }
        FrameType::BUDGET => {
            let Budget { frame, budget, used, postponed, oldest, forced } = read(payload)?;
            let bytes = start().with("frame", frame).with("budget", budget).with("used", used);
            bytes.with("postponed", postponed).with("oldest", oldest).with("forced", forced)
        }
        FrameType::GAP => {
            let Gap { first_lost, last_lost, frames, bytes, reason } = read(payload)?;
            let lost = start().with("first_lost", first_lost).with("last_lost", last_lost);
            lost.with("frames", frames).with("bytes", bytes).with("reason", reason.0)
        }
        _ => return Ok(None),
    }))
}

fn read<M: Message>(payload: &[u8]) -> Result<M, MessageError> {
    M::from_payload(payload)
}

pub(super) fn ack(ack: &Ack) -> Object {
    Object::default().with("frame", ack.frame).text("hash", &ack.hash.to_string())
}

fn limits(limits: &PeerLimits) -> String {
    let bytes = Object::default().with("frame_bytes", limits.frame_bytes).with("instances", limits.instances);
    bytes.with("buckets", limits.buckets).with("cells", limits.cells).with("points", limits.points).line()
}

fn scene(scene: &Scene) -> Object {
    let batch = |choice, first, entries: Vec<String>| {
        Object::default().with("choice", choice).with("first", first).with("entries", lines(&entries))
    };
    match scene {
        Scene::Info(info) => scene_info(info),
        Scene::Instances(all) => batch(1, all.first, all.entries.iter().map(instance).collect()),
        Scene::Sets(all) => batch(2, all.first, all.entries.iter().map(set).collect()),
        Scene::Members(all) => batch(3, all.first, all.entries.iter().map(member).collect()),
    }
}

fn scene_info(info: &SceneHeader) -> Object {
    let names = Object::default().with("choice", 0).text("name", info.name.as_str());
    names
        .text("source", info.source.as_str())
        .hex("digest", &info.digest)
        .with("profile", info.profile.0)
        .with("point_bits", info.point_bits)
        .with("coder", info.coder.0)
        .with("geometry", info.geometry.0)
        .float("fps", info.fps)
        .with("frames_hint", info.frames_hint)
        .float("radius_m", info.radius_m)
        .with("rays", info.rays)
        .with("occlusion", info.occlusion.0)
        .with("threshold", info.threshold)
        .with("seed", info.seed)
        .float("points_per_m2", info.points_per_m2)
        .with("min_points", info.min_points)
        .with("cells", info.cell_capacity)
        .with("sets", info.set_count)
        .with("instances", info.instance_count)
        .with("points", info.point_count)
        .float("table_slots", info.paper_table_slots)
        .float("view_margin", info.view_margin)
        .float("quality", info.quality)
}

fn instance(entry: &InstanceEntry) -> String {
    let grid = Object::default().with("origin", floats(&entry.origin)).float("edge", entry.edge);
    let buckets = grid.with("dims", list(entry.dims)).with("first_bucket", entry.first_bucket);
    let radius = buckets.with("buckets", entry.bucket_count).float("kernel_radius", entry.kernel_radius);
    radius.with("points", entry.points).with("needs", entry.needs.bits()).line()
}

fn set(entry: &SetEntry) -> String {
    let lattice = Object::default().with("origin", floats(&entry.origin)).float("step", entry.step);
    let nodes = lattice.with("extent", list(entry.extent)).with("normal_bits", entry.normal_bits);
    let points = nodes
        .with("points", entry.points)
        .with("charts", entry.charts)
        .with("levels", entry.levels)
        .with("level_ends", list(entry.level_ends))
        .float("kernel_radius", entry.kernel_radius);
    points.text("digest", &format!("{:016x}", entry.digest)).line()
}

fn member(entry: &MemberEntry) -> String {
    Object::default().with("set", entry.set).with("needs", entry.needs.bits()).line()
}

fn edit(edit: &Edit) -> Object {
    let object = Object::default().with("instance", edit.instance);
    match edit.action {
        EditAction::Move { translation, rotation } => object
            .with("choice", 0)
            .with("translation", floats(&translation))
            .with("rotation", floats(&rotation)),
        EditAction::Release => object.with("choice", 1),
        EditAction::Show => object.with("choice", 2),
        EditAction::Hide => object.with("choice", 3),
    }
}

fn report(report: &Report) -> Object {
    let stage =
        |time: &StageTime| Object::default().with("stage", time.stage.0).with("micros", time.micros).line();
    Object::default()
        .with("frame", report.frame)
        .with("rays", report.rays)
        .with("visible", report.visible)
        .with("traced", report.traced)
        .with("changed", report.changed)
        .with("cells", report.cells)
        .with("stored", report.stored)
        .with("bucket_full", report.bucket_full)
        .with("cell_full", report.cell_full)
        .with("no_cell", report.no_cell)
        .with("outside_grid", report.outside_grid)
        .with("id_collisions", report.id_collisions)
        .with("stages", list(report.stages.iter().map(stage)))
}

pub(super) fn recording(bytes: &[u8]) -> String {
    let reader = match Reader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => {
            let word = match error {
                ReaderError::NotARecording { .. } => "recording",
                ReaderError::Version { .. } => "version",
                ReaderError::Flags { .. } => "flags",
                other => unreachable!("{other} has no word yet"),
            };
            return Object::default().text("error", word).file();
        }
    };
    let (mut records, mut damages) = (vec![], vec![]);
    for item in reader {
        match item {
            Ok(record) => {
                let FrameHeader { kind, group, sequence, length } = record.frame.header;
                let at = Object::default().with("offset", record.offset()).with("arrival", record.arrival.0);
                let place = at.with("type", kind.0).with("group", group).with("sequence", sequence);
                records.push(place.with("length", length).line());
            }
            Err(damage) => {
                let at = Object::default().with("offset", damage.offset).with("bytes", damage.lost_bytes);
                damages.push(at.text("kind", damaged(&damage.kind)).line());
            }
        }
    }
    let summary = Summary::scan(bytes, Limits::default()).unwrap();
    let entries: Vec<String> = summary
        .index()
        .iter()
        .map(|entry| {
            let at = Object::default().with("offset", entry.offset);
            match entry.kind {
                IndexKind::Scene => at.with("type", 4).line(),
                IndexKind::Edit => at.with("type", 6).line(),
                IndexKind::Keyframe { time, frame } => {
                    at.with("type", 7).with("time", time.micros()).with("frame", frame).line()
                }
            }
        })
        .collect();
    let repaired: Vec<String> = repair(&mut bytes.to_vec(), Limits::default())
        .iter()
        .map(|stretch| Object::default().with("offset", stretch.offset).with("bytes", stretch.bytes).line())
        .collect();
    let index = match summary.stored_index() {
        StoredIndex::Missing => "none",
        StoredIndex::Agrees => "agrees",
        StoredIndex::Differs => "differs",
    };
    Object::default()
        .with("records", lines(&records))
        .with("damages", lines(&damages))
        .with("repaired", lines(&repaired))
        .with("entries", lines(&entries))
        .text("index", index)
        .with("close", summary.close().map_or("null".to_owned(), |close| close.code.0.to_string()))
        .file()
}

fn damaged(kind: &DamageKind) -> &'static str {
    match kind {
        DamageKind::FileHeader => "file header",
        DamageKind::CutOff => "cut off",
        DamageKind::Length => "length",
        DamageKind::Arrival => "arrival",
        DamageKind::Frame(_) => "frame",
        DamageKind::TooManyFalseRecords => "hopeless",
        other => unreachable!("{other} has no word yet"),
    }
}
