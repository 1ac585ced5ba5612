//! Recorders that are killed, and disks that are full.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use psao_codec::envelope::SectionTag;
use psao_proto::recording::{DamageKind, Player, PlayerEvent, Reader, StoredIndex, Summary};
use psao_proto::{FrameType, Limits, StateHash};

use crate::live::Server;
use crate::{Profile, Run, SMALL, command, fine, folder, psao, recording, text};

/// Kills of a test run; `PSAO_KILLS` asks for another number.
const KILLS: u32 = 1000;

/// Pseudo-random numbers that are the same in every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % below
    }
}

/// What the server sends: the body of every update, and the hash after every frame.
struct Sent {
    updates: BTreeMap<u32, Vec<u8>>,
    hashes: BTreeMap<u32, StateHash>,
}

impl Sent {
    fn by(path: &Path) -> Self {
        let file = std::fs::read(path).unwrap();
        let mut sent = Self { updates: BTreeMap::new(), hashes: BTreeMap::new() };
        let mut player = Player::new(&file, Limits::default()).unwrap();
        while let Some(event) = player.next_event() {
            let PlayerEvent::Frame(frame) = event else { continue };
            sent.hashes.insert(frame.info.frame.0, frame.info.hash);
            if frame.header.kind == FrameType::UPDATE {
                sent.updates.insert(frame.info.frame.0, frame.body(&file).to_vec());
            }
        }
        sent
    }

    /// Checks what a killed recorder left behind; gives its whole frames, and whether it ends inside a record.
    fn check(&self, file: &[u8], what: &str) -> (u64, bool) {
        if file.is_empty() {
            // Killed before the first record.
            return (0, false);
        }
        let mut player = match Player::new(file, Limits::default()) {
            Ok(player) => player,
            // Killed inside the first record.
            Err(_) if Reader::new(&file[..16.min(file.len())]).is_err() && file.len() < 2048 => {
                return (0, true);
            }
            Err(error) => panic!("{what}: {error}"),
        };
        let (mut previous, mut cut_off) = (None, false);
        while let Some(event) = player.next_event() {
            match event {
                PlayerEvent::Frame(frame) => {
                    let number = frame.info.frame.0;
                    assert_eq!(self.hashes.get(&number), Some(&frame.info.hash), "{what}: frame {number}");
                    // A server leaves out updates that wait when a keyframe comes, and sends one patch for those that a
                    // slow recorder missed.
                    let follows = previous.is_none_or(|before| number == before + 1);
                    let opens = frame.header.sequence.0 == 0;
                    let patched = frame.info.section(SectionTag::PATCH).is_some();
                    assert!(follows || opens || patched, "{what}: frame {number} after {previous:?}");
                    if !opens && !patched {
                        assert_eq!(frame.body(file), self.updates[&number], "{what}: frame {number}");
                    }
                    previous = Some(number);
                }
                PlayerEvent::Damage(damage) => {
                    assert_eq!(damage.kind, DamageKind::CutOff, "{what}: {damage}");
                    assert_eq!(damage.offset + damage.lost_bytes, file.len() as u64, "{what}: {damage}");
                    cut_off = true;
                }
                PlayerEvent::Scene(_) | PlayerEvent::Report(_) => {}
                other => panic!("{what}: {other:?}"),
            }
        }
        let stats = player.stats();
        assert_eq!((stats.unusable, stats.lost, stats.bad_messages), (0, 0, 0), "{what}: {stats:?}");
        assert!(stats.damages <= 1, "{what}: {stats:?}");
        (stats.applied, cut_off)
    }
}

/// A process that is killed when a test fails.
struct Doomed(Child);

impl Drop for Doomed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_killed_recorder_leaves_every_frame_whole_but_the_last() {
    let kills = std::env::var("PSAO_KILLS").map_or(KILLS, |text| text.parse().expect("a number"));
    let folder = folder();
    let (path, saved) = (folder.path().join("killed.psao"), folder.path().join("saved.psao"));
    let sent = Sent::by(recording(Profile::Surface));
    let arguments =
        ["replay", text(recording(Profile::Surface)), "--quiet", "--loop", "--pace", "wall", "--speed", "20"];
    let (_server, address) = Server::start(&arguments);
    let mut dice = Dice(1);
    let (mut frames, mut without, mut cut_off) = (0, 0, 0);
    let begun = Instant::now();
    for kill in 0..kills {
        let _ = std::fs::remove_file(&path);
        let recorder = command(&["record", "--from", &address, "-o", text(&path)])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut recorder = Doomed(recorder);
        // From the first bytes on, so that the moments are not all before the first frame.
        while std::fs::metadata(&path).map_or(0, |metadata| metadata.len()) == 0 {
            assert!(recorder.0.try_wait().unwrap().is_none(), "the recorder ended by itself");
            std::thread::sleep(Duration::from_micros(200));
        }
        std::thread::sleep(Duration::from_micros(dice.roll(200_000)));
        recorder.0.kill().unwrap();
        recorder.0.wait().unwrap();

        let file = std::fs::read(&path).unwrap();
        let (whole, cut) = sent.check(&file, &format!("kill {kill}"));
        frames += whole;
        without += u32::from(whole == 0);
        cut_off += u32::from(cut);
        // The command itself, for some of them: the library's part was checked for all.
        if whole > 0 && kill % 10 == 0 {
            let run = psao(&["recover", text(&path), "-o", text(&saved)]);
            assert_eq!(run.code, Some(if cut { 4 } else { 0 }), "kill {kill}: {}{}", run.out, run.err);
            fine(&["verify", text(&saved)]);
            let again = std::fs::read(&saved).unwrap();
            let summary = Summary::scan(&again, Limits::default()).unwrap();
            assert_eq!(summary.stored_index(), StoredIndex::Agrees, "kill {kill}");
            assert_eq!(summary.frames().len() as u64, whole, "kill {kill}");
        }
    }
    println!(
        "{kills} kills in {:.1} s: {frames} whole frames, {cut_off} files end inside a record, {without} before the \
         first frame",
        begun.elapsed().as_secs_f64()
    );
    assert!(frames > u64::from(kills), "the recorders were killed too early to show anything");
}

#[test]
fn a_full_disk_stops_neither_the_stream_nor_the_program() {
    let full = Path::new("/dev/full");
    if !full.exists() {
        println!("SKIPPED: this system has no /dev/full");
        return;
    }
    let mut arguments = vec!["serve", "--scene", "asteroids", "--fps", "60", "--frames", "8"];
    arguments.extend(["--listen", "127.0.0.1:0", "--record", text(full)]);
    arguments.extend(SMALL);
    let run = psao(&arguments);
    assert_eq!(run.code, Some(1), "{}", run.err);
    assert!(run.err.contains("8 frames sent"), "{}", run.err);
    assert_eq!(
        run.err.matches("cannot write /dev/full").count(),
        2,
        "said once, and at the end: {}",
        run.err
    );
    assert!(run.err.contains("8 frames") && run.err.contains("missing"), "{}", run.err);

    let (server, address) = Server::start(&["replay", text(recording(Profile::Surface)), "--quiet"]);
    let run = psao(&["record", "--from", &address, "-o", text(full)]);
    assert_eq!(run.code, Some(1), "{}", run.err);
    assert!(run.err.contains("/dev/full"), "{}", run.err);
    assert_eq!(server.wait(), Some(0), "the stream went on to its end");
}

#[test]
fn a_live_server_records_what_its_clients_see() {
    let folder = folder();
    let (own, remote) = (folder.path().join("own.psao"), folder.path().join("remote.psao"));
    for profile in Profile::ALL {
        let mut arguments =
            vec!["serve", "--scene", "asteroids", "--fps", "60", "--frames", "12", "--timings"];
        arguments.extend(["--record", text(&own), "--profile", profile.name()]);
        arguments.extend(SMALL);
        let (server, address) = Server::start(&arguments);
        let run: Run = command(&["record", "--from", &address, "-o", text(&remote)]).output().unwrap().into();
        assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
        assert_eq!(server.wait(), Some(0));
        let verdict = fine(&["verify", text(&own)]);
        assert!(verdict.contains("12 frames applied") && verdict.contains("the server stops"), "{verdict}");
        let sent = Sent::by(&own);
        let seen = Sent::by(&remote);
        assert!(!seen.hashes.is_empty());
        for (frame, hash) in &seen.hashes {
            assert_eq!(sent.hashes.get(frame), Some(hash), "frame {frame}");
        }
    }
}

#[test]
fn a_recording_that_is_taken_away_is_said() {
    let folder = folder();
    let path = folder.path().join("gone.psao");
    let mut arguments = vec!["serve", "--scene", "asteroids", "--fps", "10", "--frames", "6"];
    arguments.extend(["--listen", "127.0.0.1:0", "--record", text(&path)]);
    arguments.extend(SMALL);
    let server = command(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    while std::fs::metadata(&path).map_or(0, |metadata| metadata.len()) == 0 {
        std::thread::sleep(Duration::from_millis(5));
    }
    std::fs::remove_file(&path).unwrap();
    let run: Run = server.wait_with_output().unwrap().into();
    assert_eq!(run.code, Some(1), "{}", run.err);
    assert!(run.err.contains("gone.psao") && run.err.contains("6 frames sent"), "{}", run.err);
}

#[test]
fn a_place_that_cannot_be_recorded_to_is_refused_before_the_work() {
    let mut arguments = vec!["serve", "--scene", "asteroids", "--listen", "127.0.0.1:0"];
    arguments.extend(["--record", "/nowhere/at/all/a.psao"]);
    arguments.extend(SMALL);
    let run = psao(&arguments);
    assert_eq!(run.code, Some(1), "{}", run.err);
    assert!(run.err.contains("/nowhere/at/all/a.psao"), "{}", run.err);
}
