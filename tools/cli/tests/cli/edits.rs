//! Scenes that are edited while they are streamed.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::Stdio;

use psao_proto::Limits;
use psao_proto::message::{Edit, EditAction};
use psao_proto::net::{ConnectOptions, connect};
use psao_proto::session::ClientEvent;

use crate::{FRAMES, Profile, SMALL, command, fine, folder, hashes, psao, record, recording, text};

/// A column that moves and a boulder that goes, before frame 4; all as it was from frame 8 on.
const SCRIPT: &str = "4 5 move 0.9,0.34,0.2 0,0,0.7071,0.7071\n4 \"boulder 1\" hide\n\
                      8 5 release\n8 47 show # boulder 1\n8 47 show\n";

fn edited(profile: Profile, folder: &Path) -> std::path::PathBuf {
    let (script, path) = (folder.join("script.txt"), folder.join("edited.psao"));
    std::fs::write(&script, SCRIPT).unwrap();
    record("colonnade", profile, &["--edits", text(&script)], &path);
    path
}

fn picture(recording: &Path, frame: u32, to: &Path) -> Vec<u8> {
    let frame = frame.to_string();
    let camera = "--camera=1.5,1.9,5,0,0.8,0";
    fine(&["reconstruct", text(recording), "--frame", &frame, camera, "--size", "96x54", "-o", text(to)]);
    std::fs::read(to).unwrap()
}

#[test]
fn a_script_changes_the_stream_from_its_frame_on_and_pictures_show_it() {
    for profile in Profile::ALL {
        let folder = folder();
        let path = edited(profile, folder.path());
        let of = |path: &Path| hashes(&fine(&["inspect", text(path), "--format", "csv"]));
        let (plain, changed) = (of(recording(profile)), of(&path));
        assert_eq!(plain.len(), changed.len());
        assert_eq!(plain[..4], changed[..4]);
        assert_ne!(plain[4], changed[4]);
        let target = folder.path().join("a.png");
        let shown = [3, 5].map(|frame| {
            let edited = picture(&path, frame, &target);
            let plain = picture(recording(profile), frame, &target);
            edited != plain
        });
        assert_eq!(shown, [false, true], "{profile:?}");
        fine(&["verify", text(&path)]);
        let again = folder.path().join("again");
        std::fs::create_dir(&again).unwrap();
        let same = std::fs::read(&path).unwrap() == std::fs::read(edited(profile, &again)).unwrap();
        assert!(same, "same script, same bytes");
    }
}

#[test]
fn a_bad_script_is_refused_with_its_line_before_anything_is_written() {
    let folder = folder();
    let (script, target) = (folder.path().join("bad.txt"), folder.path().join("out.psao"));
    std::fs::write(&script, "# fine\n0 3 hide\n0 3 move 1e30,0,0\n").unwrap();
    let frames = FRAMES.to_string();
    let mut arguments = vec!["record", "--scene", "colonnade", "--frames", &frames, "-o", text(&target)];
    arguments.extend(SMALL);
    let refuse = |edits: &Path, words: &[&str]| {
        let run = psao(&[&arguments[..], &["--edits", text(edits)]].concat());
        assert_eq!(run.code, Some(3), "{}{}", run.out, run.err);
        assert!(words.iter().all(|word| run.err.contains(word)), "{}", run.err);
    };
    refuse(&script, &["bad.txt:3: ", "1e9 m"]);
    refuse(&folder.path().join("none.txt"), &["none.txt", "cannot read"]);
    assert!(!target.exists());
}

#[test]
fn instances_are_listed_as_scripts_name_them() {
    let table = fine(&["scenes", "--instances", "colonnade"]);
    assert!(table.contains("boulder 1") && table.contains("deforming"), "{table}");
    let csv = fine(&["scenes", "--instances", "colonnade", "--format", "csv"]);
    assert!(csv.lines().any(|line| line.starts_with("colonnade,47,boulder 1,rigid,")), "{csv}");
    let json = fine(&["scenes", "--instances", "colonnade", "--format", "json"]);
    let list: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&list[5]["name"], &list[5]["motion"]), (&"column".into(), &"static".into()));
    assert_eq!(list[5]["rotation"], serde_json::json!([0.0, 0.0, 0.0, 1.0]));
}

/// What a live server says of the edits that a client asks for: the line that names a refusal.
fn refusal(options: &[&str], edits: &[Edit]) -> String {
    let mut arguments = vec!["serve", "--scene", "asteroids", "--listen", "127.0.0.1:0"];
    // Some seconds: it is stopped as soon as it has answered.
    arguments.extend(["--frames", "400", "--fps", "20"]);
    arguments.extend(SMALL);
    arguments.extend(options);
    let mut server = command(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(server.stderr.take().unwrap()).lines().map(Result::unwrap);
    let first = lines.next().unwrap();
    let address = first.split_whitespace().find(|word| word.starts_with("127.0.0.1:")).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let _connection = runtime.block_on(async {
        let address = address.trim_end_matches(';').parse().unwrap();
        let mut connection = connect(&address, &ConnectOptions::default(), Limits::default()).await.unwrap();
        let applied = |event: &ClientEvent| matches!(event, ClientEvent::Applied(_));
        while !connection.next_event().await.unwrap().as_ref().is_some_and(applied) {}
        for edit in edits {
            connection.session().edit(edit).unwrap();
        }
        connection.flush().await.unwrap();
        connection
    });
    let line = lines.find(|line| line.contains("refused"));
    server.kill().unwrap();
    server.wait().unwrap();
    line.expect("it says so")
}

#[test]
fn a_live_server_says_which_edits_it_refuses() {
    let hide = |instance| Edit { instance, action: EditAction::Hide };
    let allowed = refusal(&[], &[hide(1), hide(99_999)]);
    assert!(allowed.contains("edit refused: instance 99999 does not exist"), "{allowed}");
    let denied = refusal(&["--edits", "deny"], &[hide(1)]);
    assert!(denied.contains("edit refused: the server runs with --edits deny"), "{denied}");
}

#[test]
fn what_one_client_changes_all_of_them_hear() {
    let mut arguments = vec!["serve", "--scene", "asteroids", "--listen", "127.0.0.1:0"];
    arguments.extend(["--frames", "400", "--fps", "20"]);
    arguments.extend(SMALL);
    let mut server = command(&arguments).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(server.stderr.take().unwrap()).lines().map(Result::unwrap);
    let first = lines.next().unwrap();
    let address = first.split_whitespace().find(|word| word.starts_with("127.0.0.1:")).unwrap();
    let address = address.trim_end_matches(';');
    let other = command(&["client", address, "--frames", "60", "--quiet"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    assert!(lines.any(|line| line.contains("joined")));
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("edits.txt");
    std::fs::write(&script, "0 1 hide\n0 2 move 0,3,0\n").unwrap();
    let editor = ["client", address, "--scene", "asteroids", "--edits", text(&script)];
    let editor = psao(&[&editor[..], &["--frames", "30", "--quiet"]].concat());
    let other = other.wait_with_output().unwrap();
    server.kill().unwrap();
    server.wait().unwrap();
    for (heard, code) in
        [(editor.err, editor.code), (String::from_utf8(other.stderr).unwrap(), other.status.code())]
    {
        assert_eq!(code, Some(0), "{heard}");
        for words in ["instance 1 is hidden", "instance 2 was moved to 0 3 0"] {
            assert_eq!(heard.matches(words).count(), 1, "{heard}");
        }
    }
    assert!(editor.out.contains("scene to applied"), "{}", editor.out);
}
