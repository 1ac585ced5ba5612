//! The bodies that a decoder must take.

use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::{self, PointFormat, PointSample, Pose, keyframe};
use psao_codec::surface::{self, ChangeLog, Encoder, EncoderSettings, GeometrySource, NO_VALUE};

use super::Vector;
use super::scenes::{self, Stream, ao};

const PLAIN: [(&str, BlockCoder); 3] =
    [("stored", BlockCoder::Stored), ("lz4", BlockCoder::Lz4), ("zstd", BlockCoder::Zstd { level: 15 })];
const RANGE: (&str, BlockCoder) = ("range", BlockCoder::Range);

pub(super) fn vectors() -> Vec<Vector> {
    let mut all = vec![];
    for (name, format) in scenes::FORMATS {
        for coder in PLAIN {
            paper(&mut all, name, format, coder);
        }
    }
    tiny(&mut all);
    for coder in PLAIN.into_iter().chain([RANGE]) {
        hall(&mut all, coder);
    }
    shared(&mut all);
    mixed(&mut all);
    chain(&mut all);
    crowd(&mut all);
    patches(&mut all);
    patches_of_a_crowd(&mut all);
    patches_with_arrivals(&mut all);
    all
}

fn meta(kind: FrameKind, frame: u32) -> FrameMeta {
    let time = StreamTime(u64::from(frame) * 16_667);
    FrameMeta { kind, frame: FrameIndex(frame), time, changed_points: 3 * frame }
}

/// Six points and what happens to them: a keyframe, a delta, an empty delta, a keyframe of what is there then.
fn paper(
    all: &mut Vec<Vector>,
    layout: &'static str,
    format: PointFormat,
    (word, coder): (&str, BlockCoder),
) {
    let Stream::Paper { layout: table, .. } = scenes::paper(layout, format) else { unreachable!() };
    let sample = |local, normal, ao| PointSample { local, normal, ao };
    let mut encoder = paper::Encoder::new(table, &[4, 2]).unwrap();
    let mut note = |part: &str, after: Option<&str>, body| {
        let name = format!("{layout}-{word}-{part}");
        let after = after.map(|part| format!("{layout}-{word}-{part}"));
        all.push(Vector { name, layout, after, body, full: word == "stored" });
    };
    encoder.put(0, &sample([0.3, 0.1, 0.6], [0.0, 1.0, 0.0], 200)).unwrap();
    encoder.put(1, &sample([0.32, 0.12, 0.7], [1.0, 1.0, 0.0], 0)).unwrap();
    encoder.put(2, &sample([0.0, 0.74, 1.2], [0.0, 0.0, -1.0], 255)).unwrap();
    encoder.put(3, &sample([0.9, 0.0, 0.0], [-1.0, 0.0, 0.0], 77)).unwrap();
    encoder.put(4, &sample([-0.4, 0.5, 2.2], [-1.0, -2.0, -3.0], 128)).unwrap();
    encoder.set_pose(0, Pose { translation: [1.0, -2.0, 3.5], ..Pose::IDENTITY }).unwrap();
    note("key", None, encoder.finish(meta(FrameKind::Key, 5), coder).unwrap().body);
    // AO alone; a move within the cell and into another; a point that goes, one that comes; a turn.
    encoder.put(0, &sample([0.3, 0.1, 0.6], [0.0, 1.0, 0.0], 100)).unwrap();
    encoder.put(1, &sample([0.26, 0.2, 0.7], [1.0, 1.0, 0.0], 9)).unwrap();
    encoder.put(2, &sample([0.6, 0.74, 1.2], [0.0, 0.0, -1.0], 255)).unwrap();
    encoder.remove(3).unwrap();
    encoder.put(5, &sample([0.1, 0.3, 3.0], [0.6, 0.0, 0.8], 31)).unwrap();
    encoder.set_pose(1, Pose { translation: [0.0, 0.25, 0.0], rotation: [0.6, 0.0, 0.0, 0.8] }).unwrap();
    note("delta", Some("key"), encoder.finish(meta(FrameKind::Delta, 7), coder).unwrap().body);
    note("empty", Some("delta"), encoder.finish(meta(FrameKind::Delta, 8), coder).unwrap().body);
    // It keeps the words of the cell whose point went.
    note("late", None, keyframe(encoder.state(), meta(FrameKind::Key, 8), coder).unwrap());
}

/// A surface stream as it is written.
struct Tape {
    layout: &'static str,
    prefix: String,
    encoder: Encoder,
    log: ChangeLog,
    frame: u32,
    after: Option<String>,
}

impl Tape {
    fn new(stream: Stream, prefix: &str, threshold: u8) -> Tape {
        let Stream::Surface { name, layout, geometry, shared } = stream else { unreachable!() };
        let source = if shared { GeometrySource::Shared } else { GeometrySource::Sent };
        let encoder = Encoder::new(layout, geometry, EncoderSettings::new(threshold, source)).unwrap();
        let log = ChangeLog::new(encoder.state());
        Tape { layout: name, prefix: prefix.to_owned(), encoder, log, frame: 0, after: None }
    }

    /// Says what the AO of some points is at a time.
    fn offer(&mut self, points: impl IntoIterator<Item = u32>, time: u32) {
        for point in points {
            self.encoder.set_ao(point, ao(point, time)).unwrap();
        }
    }

    /// A frame that nobody keeps.
    fn silent(&mut self) {
        self.frame += 1;
        self.encoder.finish(meta(FrameKind::Delta, self.frame), BlockCoder::Stored).unwrap();
        self.log.record(self.encoder.state());
    }

    /// The next frame as a vector after the one before.
    fn write(&mut self, part: &str, kind: FrameKind, coder: BlockCoder, full: bool) -> Vector {
        self.frame += 1;
        let body = self.encoder.finish(meta(kind, self.frame), coder).unwrap().body;
        self.log.record(self.encoder.state());
        let after = self.after.take().filter(|_| kind == FrameKind::Delta);
        let name = format!("{}-{part}", self.prefix);
        self.after = Some(name.clone());
        Vector { name, layout: self.layout, after, body, full }
    }

    /// A keyframe of what clients hold, for one that joins now.
    fn late(&mut self, part: &str, coder: BlockCoder, first: &[(u32, u32)]) -> Vector {
        let body =
            surface::keyframe(self.encoder.state(), meta(FrameKind::Key, self.frame), coder, first).unwrap();
        let name = format!("{}-{part}", self.prefix);
        Vector { name, layout: self.layout, after: None, body, full: true }
    }

    /// A patch for clients from frame `base` on, as one finds it whose last frame was the vector `after`.
    fn patch(&self, part: &str, base: u32, after: &str, coder: BlockCoder, context: bool) -> Vector {
        let (state, base, meta) =
            (self.encoder.state(), FrameIndex(base), meta(FrameKind::Delta, self.frame));
        let body = surface::patch(state, &self.log, base, meta, coder, context).unwrap().unwrap();
        let (name, after) = (format!("{}-{part}", self.prefix), Some(format!("{}-{after}", self.prefix)));
        Vector { name, layout: self.layout, after, body, full: true }
    }

    fn points(&self) -> u32 {
        self.encoder.state().layout().points()
    }
}

/// The specification's example, and a keyframe of nothing.
fn tiny(all: &mut Vec<Vector>) {
    all.push(Tape::new(scenes::tiny(), "tiny", 8).write("nothing", FrameKind::Key, BlockCoder::Stored, true));
    for (word, coder) in [PLAIN[0], RANGE] {
        let mut tape = Tape::new(scenes::tiny(), &format!("tiny-{word}"), 8);
        for (point, ao) in [(0, 255), (1, 200), (2, 100)] {
            tape.encoder.set_ao(point, ao).unwrap();
        }
        all.push(tape.write("key", FrameKind::Key, coder, true));
        tape.encoder.set_ao(1, 100).unwrap();
        all.push(tape.write("delta", FrameKind::Delta, coder, true));
        all.push(tape.late("late", coder, &[]));
        // A point loses its value and gets another one.
        tape.encoder.set_ao(2, NO_VALUE).unwrap();
        all.push(tape.write("removal", FrameKind::Delta, coder, true));
        tape.encoder.set_ao(2, 60).unwrap();
        all.push(tape.write("new-value", FrameKind::Delta, coder, true));
    }
}

/// Every kind of frame by one coder.
fn hall(all: &mut Vec<Vector>, (word, coder): (&str, BlockCoder)) {
    let mut tape = Tape::new(scenes::hall(), &format!("hall-{word}"), 8);
    let points = tape.points();
    let full = coder == BlockCoder::Range;
    // Instances 0, 1 and a part of 2; what is left comes later, in an order of its own.
    tape.offer((0..410).rev(), 0);
    all.push(tape.write("key", FrameKind::Key, coder, true));
    tape.offer(0..410, 1);
    all.push(tape.write("delta", FrameKind::Delta, coder, full));
    tape.offer((528..700).chain(0..410), 2);
    all.push(tape.write("arrival", FrameKind::Delta, coder, full));
    tape.encoder.set_ao(points - 1, 3).unwrap();
    all.push(tape.write("arrival-alone", FrameKind::Delta, coder, full));
    all.push(tape.write("empty", FrameKind::Delta, coder, false));
    tape.offer((0..410).chain(528..700), 5);
    all.push(tape.write("delta-after-empty", FrameKind::Delta, coder, full));
    if coder == BlockCoder::Stored {
        // What was learned takes 76 kB then; one of the small stream has it.
        return;
    }
    // A client that joins here, its view on instance 4, and goes on with the others.
    let late = tape.late("late", coder, &[(4, 0), (1, 2), (9, 9), (4, 0)]);
    let joined = late.name.clone();
    all.push(late);
    tape.offer((0..410).chain(528..700), 6);
    let next = tape.write("delta-for-all", FrameKind::Delta, coder, full);
    all.push(Vector {
        name: format!("{}-delta-for-late", tape.prefix),
        after: Some(joined),
        body: next.body.clone(),
        ..next
    });
    all.push(next);
    tape.offer(0..points, 7);
    all.push(tape.write("new-group", FrameKind::Key, coder, true));
    tape.offer(0..points, 8);
    all.push(tape.write("new-group-delta", FrameKind::Delta, coder, false));
}

/// Geometry that both sides have already.
fn shared(all: &mut Vec<Vector>) {
    for (word, coder) in [PLAIN[2], RANGE] {
        let mut tape = Tape::new(scenes::pair(), &format!("pair-{word}"), 4);
        tape.offer((0..40).chain(66..70), 0);
        // The other ball is nearly the same.
        for point in 70..134 {
            let like = if point % 11 == 0 { point } else { point - 70 };
            tape.encoder.set_ao(point, ao(like, 0)).unwrap();
        }
        all.push(tape.write("key", FrameKind::Key, coder, true));
        tape.offer(0..134, 1);
        all.push(tape.write("delta", FrameKind::Delta, coder, true));
    }
}

/// A coder of its own for every frame: the history goes on, and what the range coder learned waits.
fn mixed(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::hall(), "mixed", 3);
    let order = [PLAIN[2], RANGE, PLAIN[1], RANGE, PLAIN[0], PLAIN[2], RANGE, RANGE];
    for (number, (word, coder)) in (0..).zip(order) {
        tape.offer(0..tape.points(), number);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&format!("{number}-{word}"), kind, coder, false));
    }
}

/// A long group at the finest threshold; then one that joins after a long silence.
fn chain(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::hall(), "chain", 1);
    let points = tape.points();
    for number in 0..24 {
        // A block in the middle of the floor and the last instances come later; one frame changes everything there is, one
        // nothing.
        let here = |point: &u32| number >= 9 || *point < points - 300 && !(128..192).contains(point);
        match number {
            13 => (0..points).for_each(|point| assert!(tape.encoder.set_ao(point, point as u8).is_some())),
            14 => {}
            _ => tape.offer((0..points).filter(here), number),
        }
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&format!("{number:02}"), kind, BlockCoder::Range, number % 23 == 0));
    }
    (0..233).for_each(|_| tape.silent());
    tape.offer(0..60, 31);
    (0..15).for_each(|_| tape.silent());
    let late = tape.late("aged", BlockCoder::Range, &[]);
    tape.after = Some(late.name.clone());
    all.push(late);
    // Ages pass 20 and 255 while these go by.
    for number in 0..9 {
        tape.offer((0..points).filter(|point| point % 9 == number), 40 + number);
        all.push(tape.write(&format!("aged-{number}"), FrameKind::Delta, BlockCoder::Range, false));
    }
}

/// Many instances, some of them not there: more than a group of blocks in a row.
fn crowd(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::crowd(), "crowd", 2);
    let points = tape.points();
    let here = |point: &u32| !(150..220).contains(point) && point % 37 != 5;
    for number in 0..5 {
        tape.offer((0..points).filter(here), number);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&number.to_string(), kind, BlockCoder::Range, number == 4));
    }
}

/// What clients are sent that missed frames: by every coder, for the first and the last frame that it suits, with what was
/// learned and without, from a long time ago, of nothing, into a new group.
fn patches(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::hall(), "patch", 4);
    // The last ball never comes.
    let points = tape.points() - 64;
    for number in 0..5 {
        tape.offer(0..points, number);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&number.to_string(), kind, BlockCoder::Range, number == 4));
    }
    // Frame n is vector n - 1.
    for (word, coder) in PLAIN.into_iter().chain([RANGE]) {
        all.push(tape.patch(&format!("{word}-first"), 2, "1", coder, false));
        all.push(tape.patch(&format!("{word}-last"), 2, "3", coder, false));
        if coder != BlockCoder::Stored {
            all.push(tape.patch(&format!("{word}-context"), 1, "2", coder, true));
        }
    }
    tape.offer(0..points, 5);
    let next = tape.write("next", FrameKind::Delta, BlockCoder::Range, true);
    let (name, after) = ("patch-next-for-patched".to_owned(), Some("patch-range-context".to_owned()));
    all.push(Vector { name, after, body: next.body.clone(), ..next });
    all.push(next);
    (0..140).for_each(|_| tape.silent());
    all.push(tape.patch("nothing", 6, "next", BlockCoder::Range, false));
    all.push(tape.patch("nothing-stored", 6, "next", BlockCoder::Stored, false));
    tape.offer((0..points).filter(|point| point % 5 == 0), 6);
    tape.silent();
    all.push(tape.patch("far", 5, "next", BlockCoder::Range, false));
    all.push(tape.patch("far-stored", 5, "4", BlockCoder::Stored, false));
    tape.offer(0..points, 7);
    all.push(tape.write("new-group", FrameKind::Key, BlockCoder::Range, false));
    all.push(tape.patch("into-new-group", 6, "next", BlockCoder::Range, true));
}

/// What clients are sent that missed frames in which balls arrived: by every coder, for one that has none of them and for one
/// that has some.
fn patches_with_arrivals(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::hall(), "arrivals", 4);
    let points = tape.points();
    for (number, missing) in (0..).zip([64 * 3, 64, 0]) {
        tape.offer(0..points - missing, number);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&number.to_string(), kind, BlockCoder::Range, false));
    }
    // Frame n is vector n - 1.
    for (word, coder) in PLAIN.into_iter().chain([RANGE]) {
        all.push(tape.patch(&format!("{word}-all"), 1, "0", coder, false));
        all.push(tape.patch(&format!("{word}-some"), 1, "1", coder, false));
    }
    all.push(tape.patch("context", 1, "0", BlockCoder::Range, true));
}

/// Many instances, some of them not there: groups of blocks to pass over.
fn patches_of_a_crowd(all: &mut Vec<Vector>) {
    let mut tape = Tape::new(scenes::crowd(), "patch-crowd", 2);
    let points = tape.points();
    let here = |point: &u32| !(150..220).contains(point) && point % 37 != 5;
    for number in 0..3 {
        let stirs = |point: &u32| number == 0 || point % 160 < 9 || *point > 400;
        tape.offer((0..points).filter(here).filter(stirs), number);
        let kind = if number == 0 { FrameKind::Key } else { FrameKind::Delta };
        all.push(tape.write(&number.to_string(), kind, BlockCoder::Range, false));
    }
    all.push(tape.patch("all", 1, "0", BlockCoder::Range, false));
}
