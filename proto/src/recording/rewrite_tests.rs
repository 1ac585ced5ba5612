//! Cutting, concatenating and recovering: what plays out of the new file is what played out of the old one.

use std::convert::Infallible;

use super::*;
use crate::message::{Edit, EditAction, GapReason, Message as _};
use crate::sample::{SampleServer, recording_of};
use crate::{FrameIndex, FrameType, Limits, Micros, Numbering, Profile, StateHash, StreamTime};

const PROFILES: [Profile; 2] = [Profile::PAPER, Profile::SURFACE];

type Rewriting = Result<(Vec<u8>, RewriteOutcome), RewriteError<Infallible>>;

fn collect(
    rewrite: impl FnOnce(
        &mut dyn FnMut(&[u8]) -> Result<(), Infallible>,
    ) -> Result<RewriteOutcome, RewriteError<Infallible>>,
) -> Rewriting {
    let mut out = Vec::new();
    let done = rewrite(&mut |bytes| {
        out.extend_from_slice(bytes);
        Ok(())
    })?;
    Ok((out, done))
}

fn cut_out(file: &[u8], bounds: Bounds) -> Rewriting {
    collect(|put| cut(file, &bounds, Limits::default(), put))
}

fn frames(from: u32, to: u32) -> Bounds {
    Bounds::Frames(FrameIndex(from), FrameIndex(to))
}

fn recovered(file: &[u8], keep_all: bool) -> (Vec<u8>, RewriteOutcome) {
    collect(|put| recover(file, keep_all, Limits::default(), put)).unwrap()
}

fn joined(files: &[&[u8]]) -> (Vec<u8>, Vec<RewriteOutcome>) {
    let mut out = Vec::new();
    let put = |bytes: &[u8]| {
        out.extend_from_slice(bytes);
        Ok::<(), Infallible>(())
    };
    let mut all = Concatenation::new(Limits::default(), put).unwrap();
    let parts = files.iter().map(|file| all.add(file).unwrap()).collect();
    let length = all.finish().unwrap();
    assert_eq!(length, out.len() as u64);
    (out, parts)
}

/// Plays a file. Returns frame numbers and hashes, and the player's counts. Arrivals must not decrease.
fn play(file: &[u8]) -> (Vec<(u32, StateHash)>, PlayerStats) {
    let mut player = Player::new(file, Limits::default()).unwrap();
    let (mut frames, mut arrival) = (Vec::new(), Micros(0));
    while let Some(event) = player.next_event() {
        if let PlayerEvent::Frame(frame) = event {
            assert_eq!(player.state().unwrap().full_hash(), frame.info.hash);
            assert!(frame.arrival >= arrival, "frame {} arrives earlier", frame.info.frame);
            arrival = frame.arrival;
            frames.push((frame.info.frame.0, frame.info.hash));
        }
    }
    (frames, player.stats())
}

fn records(file: &[u8]) -> Vec<Record<'_>> {
    Reader::new(file).unwrap().map(Result::unwrap).collect()
}

fn count(file: &[u8], kind: FrameType) -> u64 {
    Summary::scan(file, Limits::default()).unwrap().count(kind).frames
}

/// Returns a recording with edits: two before frame 3, one before frame 6.
fn edited(profile: Profile) -> Vec<u8> {
    let mut server = SampleServer::of(profile).unwrap();
    let numbering = &mut Numbering::default();
    let (mut writer, mut file) = Writer::new(Limits::default());
    let mut add = |frame: &[u8]| file.extend(writer.append(Micros(0), frame).unwrap());
    numbering.scene(server.scene()).unwrap().iter().for_each(|frame| add(frame));
    for number in 0..9 {
        let edits = match number {
            3 => vec![(0, EditAction::Hide), (1, EditAction::Release)],
            6 => vec![(1, EditAction::Hide), (0, EditAction::Show)],
            _ => vec![],
        };
        for (instance, action) in edits {
            add(&numbering.message(&Edit { instance, action }).unwrap());
        }
        let body = server.step().unwrap().body;
        add(&if number == 0 { numbering.keyframe(&body) } else { numbering.update(&body) }.unwrap());
    }
    file
}

fn edits_of(file: &[u8]) -> Vec<(u32, EditAction)> {
    let edits = records(file).into_iter().filter(|record| record.frame.header.kind == FrameType::EDIT);
    edits
        .map(|record| Edit::from_payload(record.frame.payload()).unwrap())
        .map(|edit| (edit.instance, edit.action))
        .collect()
}

#[test]
fn every_cut_plays_to_the_recorded_hashes_and_is_no_larger_than_it_must() {
    for profile in PROFILES {
        for group in [4, 100] {
            let file = recording_of(profile, 10, group).unwrap();
            let (whole, _) = play(&file);
            for (from, to) in (0..10).flat_map(|from| (from..10).map(move |to| (from, to))) {
                let (piece, done) = cut_out(&file, frames(from, to)).unwrap();
                let (played, stats) = play(&piece);
                assert_eq!(played, whole[from as usize..=to as usize], "{from} to {to}");
                assert!(stats.is_clean() && stats.gaps == 0, "{from} to {to}: {stats:?}");
                assert_eq!(
                    done,
                    RewriteOutcome { frames: u64::from(to - from + 1), ..RewriteOutcome::default() }
                );
                let summary = Summary::scan(&piece, Limits::default()).unwrap();
                assert_eq!(summary.stored_index(), StoredIndex::Agrees);
                assert_eq!(summary.close().is_some(), to == 9, "{from} to {to}");
                assert_eq!(summary.count(FrameType::REPORT).frames, u64::from(to - from + 1));
                let most = longest(&file, from, to);
                let parity = summary.count(FrameType::PARITY).record_bytes as usize;
                assert!(
                    piece.len() - parity <= most,
                    "{from} to {to}: {} bytes, at most {most}",
                    piece.len()
                );

                let time = |number: u32| StreamTime(u64::from(number) * 16_667);
                let by_time = Bounds::Time(StreamTime(time(from).0.saturating_sub(5)), time(to));
                assert_eq!(cut_out(&file, by_time).unwrap().0, piece, "{from} to {to} by time");
            }
        }
    }
}

/// Returns the largest allowed size of a cut: the scene table, a keyframe of the state at `from`, the frames after it,
/// and headers.
fn longest(file: &[u8], from: u32, to: u32) -> usize {
    let summary = Summary::scan(file, Limits::default()).unwrap();
    let index = summary.frames();
    let mut player = Player::new(file, Limits::default()).unwrap();
    while player.last_applied() != Some(FrameIndex(from)) {
        player.next_event().unwrap();
    }
    let end = index.get(to as usize + 1).map_or(u64::MAX, |entry| entry.offset);
    let first = index[from as usize].offset;
    let mut sum = RECORD_HEAD_BYTES + crate::HEADER_BYTES + player.keyframe().unwrap().unwrap().len();
    for record in records(file) {
        let kind = record.frame.header.kind;
        let wanted = kind == FrameType::SCENE || (first + 1..end).contains(&record.offset());
        let copied = !matches!(kind, FrameType::INDEX | FrameType::PARITY);
        sum += if wanted && copied { record.record_bytes() as usize } else { 0 };
    }
    // The scene table, the first frame, and the groups that begin after it.
    let groups = index[from as usize + 1..=to as usize].iter().filter(|entry| entry.keyframe).count();
    let entries = (2 + groups) * INDEX_ENTRY_BYTES;
    sum + FILE_HEADER_BYTES + RECORD_HEAD_BYTES + crate::HEADER_BYTES + entries + FOOTER_BYTES
}

#[test]
fn a_cut_keeps_bodies_byte_for_byte_and_the_smaller_keyframe() {
    for profile in PROFILES {
        let file = recording_of(profile, 10, 4).unwrap();
        let (piece, _) = cut_out(&file, frames(4, 7)).unwrap();
        let bodies = |file| -> Vec<Vec<u8>> {
            let states = records(file).into_iter().filter(|r| r.frame.header.kind.carries_state());
            states.map(|record| record.frame.payload().to_vec()).collect()
        };
        assert_eq!(bodies(&piece)[1..], bodies(&file)[5..8]);
        assert!(bodies(&piece)[0].len() <= bodies(&file)[4].len());
    }
}

#[test]
fn a_cut_brings_the_edits_that_hold() {
    use EditAction::{Hide, Release, Show};
    for profile in PROFILES {
        let file = edited(profile);
        let (whole, _) = play(&file);
        for (from, to, edits) in [
            (0, 2, vec![]),
            (1, 4, vec![(0, Hide), (1, Release)]),
            (3, 5, vec![(0, Hide)]),
            (5, 8, vec![(0, Hide), (1, Hide), (0, Show)]),
            (6, 8, vec![(1, Hide)]),
        ] {
            let (piece, _) = cut_out(&file, frames(from, to)).unwrap();
            assert_eq!(edits_of(&piece), edits, "{from} to {to}");
            let (played, stats) = play(&piece);
            assert_eq!(played, whole[from as usize..=to as usize]);
            assert!(stats.is_clean());
        }
    }
}

#[test]
fn ranges_without_frames_are_refused() {
    let file = recording_of(Profile::SURFACE, 10, 4).unwrap();
    let outside = |bounds| match cut_out(&file, bounds) {
        Err(RewriteError::Range(error @ RangeError::Outside { .. })) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let text = outside(frames(10, u32::MAX));
    assert_eq!(
        text,
        "there is no frame from frame 10 on: the recording has frames 0 to 9, 0 s to 0.150003 s"
    );
    outside(Bounds::Time(StreamTime(1), StreamTime(16_666)));
    let (_, head) = Writer::new(Limits::default());
    assert_eq!(cut_out(&head, frames(0, 1)), Err(RangeError::NoFrames.into()));
    let foreign = cut_out(b"not a recording", frames(0, 1));
    assert!(matches!(foreign, Err(RewriteError::Reader(_))), "{foreign:?}");
    let failing = |_: &[u8]| Err("full");
    assert_eq!(cut(&file, &frames(0, 1), Limits::default(), failing), Err(RewriteError::Put("full")));
}

/// Returns the file with one byte changed in the middle of a frame's record.
fn hurt(file: &[u8], frame: usize) -> Vec<u8> {
    let mut bad = file.to_vec();
    let entry = Summary::scan(file, Limits::default()).unwrap().frames()[frame];
    bad[entry.offset as usize + RECORD_HEAD_BYTES + crate::HEADER_BYTES + 5] ^= 4;
    bad
}

#[test]
fn damage_in_a_range_is_left_out_and_said_and_damage_outside_is_not() {
    for profile in PROFILES {
        let file = recording_of(profile, 10, 4).unwrap();
        let (whole, _) = play(&file);
        for frame in 0..10 {
            let bad = hurt(&file, frame);
            let group_end = (frame / 4 + 1) * 4;
            for (from, to) in (0..10).flat_map(|from| (from..10).map(move |to| (from, to))) {
                let expected: Vec<_> =
                    (from..=to).filter(|&n| n < frame || n >= group_end).map(|n| whole[n]).collect();
                let result = cut_out(&bad, frames(from as u32, to as u32));
                let Ok((piece, done)) = result else {
                    assert!(expected.is_empty(), "frame {frame}, {from} to {to}: {result:?}");
                    continue;
                };
                let (played, stats) = play(&piece);
                assert_eq!(played, expected, "frame {frame}, {from} to {to}");
                assert!(stats.is_clean(), "{stats:?}");
                let lost = (to - from + 1 - expected.len()) as u64;
                let hit = lost > 0;
                assert_eq!(!done.losses.is_empty(), hit, "frame {frame}, {from} to {to}: {done:?}");
                assert_eq!(stats.gaps > 0, hit, "frame {frame}, {from} to {to}: {stats:?}");
                // A damaged last frame cannot be recognised as a frame.
                let untold = frame == to || frame == 9;
                assert!(done.lost_frames == lost || untold, "frame {frame}, {from} to {to}: {done:?}");
            }
        }
    }
}

#[test]
fn a_mark_says_which_frames_are_missing() {
    let file = recording_of(Profile::SURFACE, 10, 5).unwrap();
    let (piece, done) = cut_out(&hurt(&file, 2), frames(1, 9)).unwrap();
    let gaps = Summary::scan(&piece, Limits::default()).unwrap().gaps().to_vec();
    let [gap] = gaps[..] else { panic!("{gaps:?}") };
    assert_eq!((gap.first_lost, gap.last_lost), (FrameIndex(2), FrameIndex(4)));
    assert_eq!((gap.frames, gap.bytes, gap.reason), (3, done.lost_bytes, GapReason::DAMAGE));
    assert_eq!((done.frames, done.lost_frames, done.losses.len()), (6, 3, 3));
}

#[test]
fn recordings_follow_each_other_under_one_scene_table() {
    for profile in PROFILES {
        let (long, short) = (recording_of(profile, 10, 4).unwrap(), recording_of(profile, 3, 9).unwrap());
        let (all, parts) = joined(&[&long, &short, &long]);
        let (played, stats) = play(&all);
        assert_eq!(played, [play(&long).0, play(&short).0, play(&long).0].concat());
        assert!(stats.is_clean(), "{stats:?}");
        assert_eq!(parts.iter().map(|part| part.frames).collect::<Vec<_>>(), [10, 3, 10]);
        assert_eq!(count(&all, FrameType::SCENE), count(&long, FrameType::SCENE));
        assert_eq!(count(&all, FrameType::CLOSE), 1);
        assert_eq!(count(&all, FrameType::REPORT), 23);
        assert_eq!(records(&all).last().unwrap().frame.header.kind, FrameType::INDEX);
        // One frame interval at 60 Hz between two recordings.
        let arrivals: Vec<u64> = records(&all)
            .iter()
            .filter(|record| record.frame.header.kind.carries_state())
            .map(|record| record.arrival.0)
            .collect();
        assert_eq!(arrivals[10] - arrivals[9], 16_667);
        // The concatenation can be cut again. A range ends at its first end.
        let (piece, _) = cut_out(&all, frames(2, 8)).unwrap();
        assert_eq!(play(&piece).0, play(&long).0[2..9]);
    }
}

#[test]
fn another_scene_or_edits_bring_a_table_of_their_own() {
    let (cells, surface) = (PROFILES.map(|profile| recording_of(profile, 4, 9).unwrap())).into();
    let (all, _) = joined(&[&cells, &surface, &surface]);
    let tables = count(&cells, FrameType::SCENE) + count(&surface, FrameType::SCENE);
    assert_eq!(count(&all, FrameType::SCENE), tables);
    let (played, stats) = play(&all);
    assert_eq!(played, [play(&cells).0, play(&surface).0, play(&surface).0].concat());
    assert!(stats.is_clean());

    let changed = edited(Profile::SURFACE);
    let (all, _) = joined(&[&changed, &changed]);
    assert_eq!(count(&all, FrameType::SCENE), 2 * count(&changed, FrameType::SCENE));
    assert_eq!(edits_of(&all), [edits_of(&changed), edits_of(&changed)].concat());
    assert!(play(&all).1.is_clean());
}

#[test]
fn jumps_bring_scene_and_edits_along() {
    let (cells, surface) = (edited(Profile::PAPER), edited(Profile::SURFACE));
    let (all, _) = joined(&[&cells, &surface]);
    let (played, _) = play(&all);
    let summary = Summary::scan(&all, Limits::default()).unwrap();
    let mut player = Player::new(&all, Limits::default()).unwrap();
    for entry in [12, 0, 17, 3, 9] {
        player.jump(&summary, entry);
        let wanted = summary.frames()[entry].offset;
        loop {
            match player.next_event().unwrap() {
                PlayerEvent::Frame(frame) if frame.offset == wanted => break,
                PlayerEvent::Frame(frame) => assert!(frame.offset < wanted, "entry {entry}"),
                _ => {}
            }
        }
        assert_eq!(player.state().unwrap().hash(), played[entry].1);
        let (file, frame) = if entry < 9 { (&cells, entry) } else { (&surface, entry - 9) };
        let mut twin = Player::new(file, Limits::default()).unwrap();
        while twin.last_applied() != Some(FrameIndex(frame as u32)) {
            twin.next_event().unwrap();
        }
        assert_eq!(player.edits(), twin.edits(), "entry {entry}");
    }
    assert!(player.stats().is_clean());
}

#[test]
fn a_damaged_file_in_the_middle_costs_its_own_frames_alone() {
    let file = recording_of(Profile::PAPER, 10, 5).unwrap();
    let (all, parts) = joined(&[&file, &hurt(&file, 7), &file]);
    let (whole, _) = play(&file);
    let (played, stats) = play(&all);
    assert_eq!(played, [&whole[..], &whole[..7], &whole[..]].concat());
    assert!(stats.is_clean() && stats.gaps == 1, "{stats:?}");
    assert_eq!(parts[1].frames, 7);
    assert_eq!((parts[0].losses.len(), parts[1].losses.len(), parts[2].losses.len()), (0, 3, 0));
}

#[test]
fn a_whole_recording_is_recovered_as_it_is() {
    for profile in PROFILES {
        let file = recording_of(profile, 10, 4).unwrap();
        let (same, done) = recovered(&file, false);
        assert_eq!((same == file, done.losses.len(), done.lost_frames), (true, 0, 0));
        // A missing, truncated or old index is rebuilt.
        let index = *records(&file).last().unwrap();
        let plain = &file[..index.offset() as usize];
        assert_eq!(recovered(plain, false), (file.clone(), done));
        let old = [&file[..], &file[index.offset() as usize..]].concat();
        assert_eq!(recovered(&old, false).0, file);
    }
}

#[test]
fn a_power_cut_at_any_byte_of_the_last_three_frames() {
    for profile in PROFILES {
        let file = edited(profile);
        let (whole, _) = play(&file);
        let ends: Vec<u64> = records(&file)
            .iter()
            .filter(|record| record.frame.header.kind.carries_state())
            .map(|record| record.offset() + record.record_bytes())
            .collect();
        for end in ends[5] as usize..=file.len() {
            let left = &file[..end];
            let kept = ends.iter().filter(|&&e| e <= end as u64).count();
            let (played, stats) = play(left);
            assert_eq!(played, whole[..kept], "cut at {end}");
            assert!(stats.damages <= 1 && stats.unusable == 0, "cut at {end}: {stats:?}");

            let (saved, done) = recovered(left, false);
            let (played, after) = play(&saved);
            assert_eq!(played, whole[..kept], "recovered from a cut at {end}");
            assert!(after.is_clean() && after.gaps == stats.damages, "cut at {end}: {after:?}");
            assert_eq!(done.lost_bytes, stats.damaged_bytes, "cut at {end}");
            assert_eq!(done.frames, kept as u64);
            let summary = Summary::scan(&saved, Limits::default()).unwrap();
            assert_eq!(summary.stored_index(), StoredIndex::Agrees);
            assert_eq!(recovered(&saved, false).0, saved, "nothing more is lost the second time");
        }
    }
}

#[test]
fn whatever_byte_is_changed_the_recovered_file_plays_what_the_damaged_one_did() {
    for profile in PROFILES {
        let file = recording_of(profile, 6, 3).unwrap();
        for place in (0..file.len()).step_by(3) {
            let mut bad = file.clone();
            bad[place] ^= 0x20;
            let (expected, stats) = play(&bad);
            let (saved, done) = recovered(&bad, false);
            let (played, after) = play(&saved);
            assert_eq!(played, expected, "byte {place}");
            let clean = (after.damages, after.unusable, after.lost) == (0, 0, 0);
            assert!(clean, "byte {place}: {after:?}");
            assert_eq!(done.lost_frames, stats.lost + stats.unusable, "byte {place}");
            assert!(!done.losses.is_empty(), "byte {place}");
        }
    }
}

#[test]
fn frames_that_build_on_damage_are_kept_when_asked() {
    let file = recording_of(Profile::SURFACE, 10, 5).unwrap();
    let bad = hurt(&file, 1);
    let (saved, done) = recovered(&bad, true);
    assert_eq!((done.frames, done.losses.len()), (9, 1));
    let (played, stats) = play(&saved);
    assert_eq!((played.len(), stats.unusable), (6, 3));
    let (saved, done) = recovered(&bad, false);
    assert_eq!((done.frames, done.lost_frames, done.losses.len()), (6, 4, 4));
    assert_eq!(play(&saved).1.unusable, 0);
}
