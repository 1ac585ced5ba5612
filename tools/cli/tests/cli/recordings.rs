//! Recordings made of recordings: cut, joined, recovered; and replays that start in the middle.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use psao_proto::recording::{FILE_HEADER_BYTES, FOOTER_BYTES, RECORD_HEAD_BYTES, Reader, Summary};
use psao_proto::{FrameType, HEADER_BYTES, Limits};

use crate::bad_input::refuses;
use crate::live::Server;
use crate::{FRAMES, Profile, Run, command, fine, folder, hashes, psao, record, recording, text};

/// Hashes of every frame of a recording, played with these options.
fn part(path: &Path, options: &[&str]) -> Vec<(String, String)> {
    let mut arguments = vec!["replay", text(path), "--format", "csv"];
    arguments.extend(options);
    let run = psao(&arguments);
    assert_eq!(run.code, Some(0), "{arguments:?}: {}", run.err);
    hashes(&run.out)
}

/// Hashes of every frame of a recording, played.
fn played(path: &Path) -> Vec<(String, String)> {
    part(path, &[])
}

fn summary(path: &Path) -> Summary {
    Summary::scan(&std::fs::read(path).unwrap(), Limits::default()).unwrap()
}

/// The records of a recording, without parity, which would repair them, and without index.
fn bare(recording: &Path) -> Vec<u8> {
    let bytes = std::fs::read(recording).unwrap();
    let mut file = bytes[..FILE_HEADER_BYTES].to_vec();
    for record in Reader::new(&bytes).unwrap().map(Result::unwrap) {
        if !matches!(record.frame.header.kind, FrameType::PARITY | FrameType::INDEX) {
            let start = record.offset() as usize;
            file.extend_from_slice(&bytes[start..start + record.record_bytes() as usize]);
        }
    }
    file
}

/// A copy of a recording without parity, with one byte changed inside the body of a frame.
fn hurt(folder: &Path, recording: &Path, frame: usize) -> PathBuf {
    let mut bytes = bare(recording);
    let entry = Summary::scan(&bytes, Limits::default()).unwrap().frames()[frame];
    bytes[entry.offset as usize + RECORD_HEAD_BYTES + HEADER_BYTES + 9] ^= 1;
    let path = folder.join("hurt.psao");
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_cut_stands_alone_and_plays_to_the_same_hashes() {
    let folder = folder();
    let path = folder.path().join("cut.psao");
    for profile in Profile::ALL {
        let whole = played(recording(profile));
        for (range, frames) in [
            (&["--from", "0.05s", "--to", "0.1s"][..], 3..=6),
            (&["--from-frame", "4", "--to-frame", "8"], 4..=8),
            (&["--from-frame", "11"], 11..=11),
            (&["--to", "0"], 0..=0),
        ] {
            let mut arguments = vec!["cut", text(recording(profile)), "-o", text(&path)];
            arguments.extend(range);
            let out = fine(&arguments);
            assert!(out.contains("wrote") && out.contains("frame"), "{out}");
            assert_eq!(played(&path), whole[frames], "{range:?}");
            fine(&["verify", text(&path)]);
        }
        // A cut of a cut is a cut.
        let again = folder.path().join("again.psao");
        fine(&["cut", text(recording(profile)), "--from-frame", "2", "--to-frame", "9", "-o", text(&path)]);
        fine(&["cut", text(&path), "--from-frame", "5", "--to-frame", "6", "-o", text(&again)]);
        assert_eq!(played(&again), whole[5..7]);
    }
}

#[test]
fn points_that_clients_make_themselves_are_cut_too() {
    let folder = folder();
    let [whole, piece] = ["whole.psao", "piece.psao"].map(|name| folder.path().join(name));
    record("colonnade", Profile::Surface, &["--geometry", "shared"], &whole);
    fine(&["cut", text(&whole), "--from-frame", "5", "-o", text(&piece)]);
    assert_eq!(played(&piece), played(&whole)[5..]);
}

#[test]
fn pieces_are_joined_to_what_they_were() {
    let folder = folder();
    let [one, two, all] = ["one.psao", "two.psao", "all.psao"].map(|name| folder.path().join(name));
    for profile in Profile::ALL {
        let whole = recording(profile);
        fine(&["cut", text(whole), "--to-frame", "4", "-o", text(&one)]);
        fine(&["cut", text(whole), "--from-frame", "5", "-o", text(&two)]);
        fine(&["cat", text(&one), text(&two), "-o", text(&all)]);
        fine(&["verify", text(&all)]);
        assert_eq!(played(&all), played(whole));
        fine(&["cat", text(whole), text(whole), text(whole), "-o", text(&all)]);
        fine(&["verify", text(&all)]);
        assert_eq!(played(&all), [played(whole), played(whole), played(whole)].concat());
    }
    let other = Profile::ALL.map(recording);
    fine(&["cat", text(other[0]), text(other[1]), "-o", text(&all)]);
    fine(&["verify", text(&all)]);
    assert_eq!(played(&all), [played(other[0]), played(other[1])].concat());
}

#[test]
fn what_is_damaged_is_said_and_the_rest_recovered() {
    let folder = folder();
    let out = folder.path().join("out.psao");
    let pieces = folder.path().join("pieces.psao");
    let whole = recording(Profile::Surface);
    fine(&["cut", text(whole), "--from-frame", "6", "-o", text(&out)]);
    fine(&["cat", text(whole), text(&out), "-o", text(&pieces)]);
    let bad = hurt(folder.path(), &pieces, 3);

    let run = psao(&["recover", text(&bad), "-o", text(&out)]);
    assert_eq!(run.code, Some(4), "{}{}", run.out, run.err);
    for words in ["checksum", "at offset", "9 frames as far as known"] {
        assert!(run.err.contains(words), "{}", run.err);
    }
    let verdict = fine(&["verify", text(&out)]);
    assert!(verdict.contains("note") && verdict.contains("9 frames from 3"), "{verdict}");
    let expected = [&played(whole)[..3], &played(whole)[6..]].concat();
    assert_eq!(played(&out), expected);
    assert!(psao(&["replay", text(&out), "--quiet"]).err.contains("9 frames from 3 to 11 are missing"));
    let json = fine(&["inspect", text(&out), "--format", "json"]);
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["gaps"][0]["frames"], 9);
    assert!(fine(&["inspect", text(&out)]).contains("Gap:"));
    // A second time nothing is lost.
    fine(&["recover", text(&out), "-o", text(&pieces)]);

    let run = psao(&["recover", text(&bad), "--keep-all", "-o", text(&out)]);
    assert_eq!(run.code, Some(4));
    assert_eq!(psao(&["verify", text(&out)]).code, Some(4), "what is kept still cannot be played");
    let run = psao(&["cut", text(&bad), "--from-frame", "2", "--to-frame", "7", "-o", text(&out)]);
    assert_eq!(run.code, Some(4), "{}", run.err);
    assert_eq!(played(&out)[0], played(whole)[2]);
    let run = psao(&["cut", text(&bad), "--to-frame", "2", "-o", text(&out)]);
    assert_eq!(run.code, Some(0), "nothing in the range is damaged: {}", run.err);
    let run = psao(&["cat", text(&bad), text(whole), "-o", text(&out)]);
    assert_eq!(run.code, Some(4), "{}", run.err);
    fine(&["verify", text(&out)]);
}

#[test]
fn one_damaged_byte_anywhere_costs_nothing() {
    let folder = folder();
    let [bad, out] = ["bad.psao", "out.psao"].map(|name| folder.path().join(name));
    for profile in Profile::ALL {
        let whole = std::fs::read(recording(profile)).unwrap();
        // In the file header, a frame's header, a keyframe, an update, and the end.
        for place in [3, 40, whole.len() / 3, whole.len() * 9 / 10] {
            let mut bytes = whole.clone();
            bytes[place] ^= 0x40;
            std::fs::write(&bad, &bytes).unwrap();
            let run = psao(&["verify", text(&bad)]);
            assert_eq!(run.code, Some(4), "{}", run.out);
            assert!(
                run.out.contains("repaired 1 damaged place") && run.err.contains("12 frames can still"),
                "{run:?}"
            );
            let run = psao(&["recover", text(&bad), "-o", text(&out)]);
            assert_eq!(run.code, Some(0), "{}", run.err);
            assert!(run.err.contains(&format!("the first at offset {place}")), "{}", run.err);
            assert_eq!(std::fs::read(&out).unwrap(), whole);
            assert_eq!(played(&bad), played(recording(profile)));
        }
    }
}

#[test]
fn keyframes_come_as_often_as_asked_and_change_no_frame() {
    let folder = folder();
    let often = folder.path().join("often.psao");
    for profile in Profile::ALL {
        record("colonnade", profile, &["--keyframe-every", "0.05s"], &often);
        assert_eq!(played(&often), played(recording(profile)), "the same states");
        let keyframes: Vec<u32> = summary(&often)
            .frames()
            .iter()
            .filter(|entry| entry.keyframe)
            .map(|entry| entry.frame.0)
            .collect();
        assert_eq!(keyframes, [0, 3, 6, 9], "{profile:?}");
        // What damage costs ends with its group.
        let bad = hurt(folder.path(), &often, 4);
        let run = psao(&["verify", text(&bad)]);
        assert!(run.err.contains("10 frames can still be played"), "{}{}", run.out, run.err);
        assert!(run.out.contains("up to 3 frames, to the next keyframe"), "{}", run.out);
        record("colonnade", profile, &["--keyframe-every", "off"], &often);
        assert_eq!(std::fs::read(&often).unwrap(), std::fs::read(recording(profile)).unwrap());
    }
    refuses(&["record", "--scene", "colonnade", "--keyframe-every", "0", "-o", text(&often)], 2, &["1ms"]);
}

#[test]
fn verify_tells_frames_in_a_row_together_and_fails_where_none_can_be_played() {
    let folder = folder();
    let whole = recording(Profile::Surface);
    let run = psao(&["verify", text(&hurt(folder.path(), whole, 0))]);
    assert_eq!(run.code, Some(4));
    assert!(
        run.out.contains("11 frames, 1 to 11") && run.out.contains("no frame can be played"),
        "{}",
        run.out
    );
    let empty = folder.path().join("empty.psao");
    std::fs::write(&empty, &std::fs::read(whole).unwrap()[..FILE_HEADER_BYTES]).unwrap();
    let run = psao(&["verify", text(&empty)]);
    assert!(run.code == Some(4) && run.out.contains("no frame can be played"), "{run:?}");
}

#[test]
fn a_whole_recording_is_recovered_without_loss() {
    let folder = folder();
    let out = folder.path().join("out.psao");
    for profile in Profile::ALL {
        let bytes = std::fs::read(recording(profile)).unwrap();
        let out_text = fine(&["recover", text(recording(profile)), "-o", text(&out)]);
        assert!(out_text.contains(&format!("{FRAMES} frames")), "{out_text}");
        assert_eq!(std::fs::read(&out).unwrap(), bytes);
        // Without its index, as after a kill.
        let cut = folder.path().join("cut.psao");
        let footer = bytes[bytes.len() - FOOTER_BYTES..].first_chunk().unwrap();
        std::fs::write(&cut, &bytes[..u64::from_le_bytes(*footer) as usize]).unwrap();
        fine(&["recover", text(&cut), "-o", text(&out)]);
        assert_eq!(std::fs::read(&out).unwrap(), bytes);
    }
}

#[test]
fn what_makes_no_sense_is_refused_and_leaves_nothing_behind() {
    let folder = folder();
    let out = folder.path().join("out.psao");
    let whole = text(recording(Profile::Surface));
    let before = std::fs::read(whole).unwrap();
    for (arguments, code, words) in [
        (&["cut", whole][..], 2, &["--from"][..]),
        (&["cut", whole, "--from", "0.1s", "--to", "0.05s"], 2, &["empty"]),
        (&["cut", whole, "--from-frame", "7", "--to-frame", "3"], 2, &["empty", "7"]),
        (&["cut", whole, "--from=-1"], 2, &["-1"]),
        (&["cut", whole, "--from", "nan"], 2, &["nan"]),
        (&["cut", whole, "--from", "0", "--to-frame", "3"], 2, &["--to-frame"]),
        (&["cut", whole, "--from", "9s"], 3, &["from 9 s on", "frames 0 to 11"]),
        (&["cut", whole, "--from", "0.001s", "--to", "0.002s"], 3, &["0.001 s to 0.002 s"]),
        (&["cut", whole, "--from-frame", "12"], 3, &["from frame 12 on"]),
        (&["cut", "/nowhere/a.psao", "--from", "0"], 3, &["/nowhere/a.psao"]),
        (&["cat"], 2, &["FILE"]),
        (&["cat", whole, "/nowhere/a.psao"], 3, &["/nowhere/a.psao"]),
        (&["recover", "/nowhere/a.psao"], 3, &["/nowhere/a.psao"]),
    ] {
        let mut all = arguments.to_vec();
        all.extend(["-o", text(&out)]);
        refuses(&all, code, words);
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            0,
            "{arguments:?} leaves something behind"
        );
    }
    let foreign = folder.path().join("foreign.psao");
    std::fs::write(&foreign, b"GIF89a, and nothing that could be a record").unwrap();
    for arguments in [
        &["cut", text(&foreign), "--from", "0"][..],
        &["cat", whole, text(&foreign)],
        &["recover", text(&foreign)],
    ] {
        let mut all = arguments.to_vec();
        all.extend(["-o", text(&out)]);
        refuses(&all, 3, &["foreign.psao", "not a psao recording"]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{arguments:?}");
    }
    // Over itself, also by another way to it.
    let around = recording(Profile::Surface).parent().unwrap().join(".").join("colonnade.psao");
    for target in [whole, text(&around)] {
        for arguments in [&["cut", whole, "--to", "1s"][..], &["cat", whole, whole], &["recover", whole]] {
            let mut all = arguments.to_vec();
            all.extend(["-o", target]);
            refuses(&all, 2, &["itself"]);
        }
    }
    assert_eq!(std::fs::read(whole).unwrap(), before);
    for place in ["/nowhere/at/all/out.psao", text(folder.path())] {
        refuses(&["cut", whole, "--to", "1s", "-o", place], 1, &[place]);
        refuses(&["cat", whole, "-o", place], 1, &[place]);
        refuses(&["recover", whole, "-o", place], 1, &[place]);
    }
}

#[test]
fn a_replay_starts_and_ends_where_it_is_told() {
    for profile in Profile::ALL {
        let whole = recording(profile);
        let all = played(whole);
        let part = |options: &[&str]| part(whole, options);
        assert_eq!(part(&["--from", "0.08s"]), all[5..]);
        assert_eq!(part(&["--from", "0.08s", "--to", "0.1s"]), all[5..=6]);
        assert_eq!(part(&["--to", "0.1s", "--pace", "wall", "--speed", "9"]), all[..=6]);
        refuses(&["replay", text(whole), "--from", "7s"], 3, &["--from 7s", "0.18"]);
        refuses(&["replay", text(whole), "--from=-1"], 2, &["--from", "-1"]);
    }
}

#[test]
fn a_looped_replay_opens_every_round_with_a_keyframe() {
    for profile in Profile::ALL {
        let all = played(recording(profile));
        let mut arguments = vec!["replay", text(recording(profile)), "--quiet", "--loop", "--pace", "step"];
        arguments.extend(["--from", "0.08s", "--to", "0.14s"]);
        let (_server, address) = Server::start(&arguments);
        let client = command(&["client", &address, "--frames", "10", "--format", "csv"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let run: Run = client.wait_with_output().unwrap().into();
        assert_eq!(run.code, Some(0), "{}", run.err);
        assert!(!run.err.contains("asked for a keyframe"), "{}", run.err);
        let round = &all[5..=8];
        assert_eq!(hashes(&run.out), [round, round, &round[..2]].concat());
        let kinds: Vec<&str> = run.out.lines().skip(1).map(|line| line.split(',').nth(2).unwrap()).collect();
        let keys: Vec<bool> = kinds.iter().map(|kind| *kind == "key").collect();
        assert_eq!(keys, (0..10).map(|line| line % 4 == 0).collect::<Vec<_>>());
    }
}
