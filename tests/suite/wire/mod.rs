//! The vectors of `tests/vectors/v1/wire`: everything around frame bodies, for other implementations.

mod accepted;
mod broken;
mod datagrams;
mod describe;
mod messages;
mod object;
mod recordings;
mod refused;
mod tables;

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use psao_proto::message::{
    Close, Edit, Gap, Message, MessageError, Occlusion, PayloadError, PointSource, Reject, Report, Request,
    Scene, SceneHeader, StageId,
};
use psao_proto::{FrameType, Framer, Limits};

use crate::vectors::compare;
use datagrams::Plan;

/// A vector: its name, its kind and its bytes.
struct Case {
    name: String,
    kind: CaseKind,
    bytes: Vec<u8>,
}

/// Content of a vector's file.
enum CaseKind {
    /// One wire frame, or the start of one.
    Frame,
    /// Datagrams, one after another.
    Datagrams(Plan),
    /// A recording.
    Recording,
    /// SCENE frames, one after another.
    Table,
}

impl Case {
    fn file(&self, ending: &str) -> PathBuf {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/vectors/v1/wire");
        PathBuf::from(folder).join(format!("{}.{ending}", self.name))
    }

    /// Returns the path of the vector's bytes.
    fn path(&self) -> PathBuf {
        self.file(if matches!(self.kind, CaseKind::Recording) { "psao" } else { "bin" })
    }

    /// Returns the JSON that describes `bytes`.
    fn json(&self, bytes: &[u8]) -> String {
        match &self.kind {
            CaseKind::Frame => describe::frame(bytes),
            CaseKind::Datagrams(plan) => plan.json(bytes),
            CaseKind::Recording => describe::recording(bytes),
            CaseKind::Table => tables::json(bytes),
        }
    }
}

fn cases() -> Vec<Case> {
    let mut all = accepted::frames();
    all.extend(broken::frames());
    all.extend(refused::frames());
    all.extend(tables::cases());
    all.extend(datagrams::cases());
    all.extend(recordings::cases());
    all
}

#[test]
fn the_code_writes_the_wire_vectors_as_they_are() {
    for case in cases() {
        compare(&case.path(), &case.bytes);
        compare(&case.file("json"), case.json(&case.bytes).as_bytes());
    }
}

#[test]
fn the_stored_wire_vectors_are_what_their_json_says() {
    let cases = cases();
    let mut names = BTreeSet::new();
    for case in &cases {
        let stored = fs::read(case.path()).unwrap();
        assert_eq!(fs::read_to_string(case.file("json")).unwrap(), case.json(&stored), "{}", case.name);
        names.extend([case.path(), case.file("json")]);
    }
    assert_eq!(names.len(), 2 * cases.len(), "a name is there twice");
    let folder = cases[0].path();
    let stored: BTreeSet<PathBuf> =
        fs::read_dir(folder.parent().unwrap()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(stored, names, "a vector is there that nobody writes, or missing");
}

/// Returns the messages of type `M` in all whole frames.
fn read<M: Message>(cases: &[Case]) -> Vec<M> {
    let mut messages = vec![];
    for case in cases.iter().filter(|case| matches!(case.kind, CaseKind::Frame)) {
        let mut framer = Framer::new(Limits::default());
        framer.push(&case.bytes);
        if let Ok(Some(frame)) = framer.next_frame()
            && frame.header.kind == M::KIND
        {
            messages.extend(M::from_payload(frame.payload()));
        }
    }
    messages
}

/// Returns the first bytes of all choices of a message that this version knows, for a choice at `at` in the payload.
fn choices<M: Message>(at: usize) -> Vec<u8> {
    let known = |choice: &u8| {
        let mut payload = [0; 12];
        payload[at] = *choice;
        let error = M::from_payload(&payload).err();
        !matches!(error, Some(MessageError::Malformed { reason: PayloadError::Variant(_), .. }))
    };
    (0..=u8::MAX).filter(known).collect()
}

/// Returns the choices that occur in the messages of type `M`, read at `at` in each payload.
fn choices_met<M: Message>(cases: &[Case], at: usize) -> BTreeSet<u8> {
    read::<M>(cases).iter().map(|message| message.to_payload().unwrap()[at]).collect()
}

#[test]
fn the_wire_vectors_cover_every_type_and_choice() {
    let cases = cases();
    let types: BTreeSet<u8> = cases
        .iter()
        .filter(|case| matches!(case.kind, CaseKind::Frame))
        .filter_map(|case| case.bytes.get(2).copied())
        .collect();
    for kind in (0..=u8::MAX).map(FrameType).filter(|kind| kind.name().is_some()) {
        assert!(types.contains(&kind.0), "no vector of {kind}");
    }
    for (name, known, met) in [
        ("SCENE", choices::<Scene>(0), choices_met::<Scene>(&cases, 0)),
        ("EDIT", choices::<Edit>(4), choices_met::<Edit>(&cases, 4)),
        ("REQUEST", choices::<Request>(0), choices_met::<Request>(&cases, 0)),
    ] {
        assert!(known.len() > 2 && known.iter().all(|choice| met.contains(choice)), "a choice of {name}");
    }
}

#[test]
fn the_wire_vectors_cover_every_code() {
    let cases = cases();
    let (closes, rejects) = (read::<Close>(&cases), read::<Reject>(&cases));
    assert!(messages::close_codes().all(|code| closes.iter().any(|close| close.code == code)));
    assert!(messages::reject_codes().all(|code| rejects.iter().any(|reject| reject.code == code)));
    let gaps = read::<Gap>(&cases);
    assert!(messages::gap_reasons().all(|reason| gaps.iter().any(|gap| gap.reason == reason)));
    let requests = read::<Request>(&cases);
    let asked = |reason| requests.contains(&Request::Keyframe { reason });
    assert!(messages::keyframe_reasons().all(asked));
    let reports = read::<Report>(&cases);
    let timed = |id| reports.iter().any(|report| report.stages.iter().any(|time| time.stage == id));
    assert!((0..=u8::MAX).map(StageId).filter(|id| id.name().is_some()).all(timed));
    let infos: Vec<SceneHeader> = read::<Scene>(&cases)
        .into_iter()
        .filter_map(|scene| if let Scene::Info(info) = scene { Some(info) } else { None })
        .collect();
    for id in [Occlusion::OBSCURANCE, Occlusion::BINARY] {
        assert!(infos.iter().any(|info| info.occlusion == id), "{id}");
    }
    for id in [PointSource::SENT, PointSource::SHARED] {
        assert!(infos.iter().any(|info| info.geometry == id), "{id}");
    }
}

#[test]
fn the_wire_vectors_cover_every_reason() {
    let (mut frames, mut tables) = (BTreeSet::new(), BTreeSet::new());
    for case in cases() {
        match case.kind {
            CaseKind::Frame => frames.extend(describe::content(&case.bytes).err()),
            CaseKind::Table => tables.extend(tables::outcome(&case.bytes).err()),
            CaseKind::Datagrams(_) | CaseKind::Recording => {}
        }
    }
    assert_eq!(frames.into_iter().collect::<Vec<_>>(), describe::REASONS);
    assert_eq!(tables.into_iter().collect::<Vec<_>>(), tables::REASONS);
}
