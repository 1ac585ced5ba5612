//! Servers and clients as processes that talk over loopback.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpListener;
use std::process::{Child, Stdio};
use std::thread::JoinHandle;

use crate::{FRAMES, Profile, Run, SMALL, command, fine, folder, hashes, psao, recording, text};

/// A server process; killed when a test fails.
pub(crate) struct Server {
    process: Child,
    /// Reads what it says on standard error.
    said: Option<JoinHandle<String>>,
}

impl Server {
    /// Starts it with `--listen 127.0.0.1:0` and gives the address that it chose.
    pub(crate) fn start(arguments: &[&str]) -> (Self, String) {
        Self::start_at("127.0.0.1:0", arguments)
    }

    /// Starts it at another address; a port 0 lets it choose.
    pub(crate) fn start_at(listen: &str, arguments: &[&str]) -> (Self, String) {
        let mut process = command(arguments)
            .args(["--listen", listen])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("psao starts");
        let mut lines = BufReader::new(process.stderr.take().expect("piped"));
        let mut line = String::new();
        lines.read_line(&mut line).expect("it says where it listens");
        let known = listen.strip_suffix('0').unwrap_or(listen);
        let address = line.split_whitespace().find(|word| word.starts_with(known));
        let address = address
            .unwrap_or_else(|| panic!("no address in {line:?}"))
            .trim_end_matches([',', ';'])
            .to_owned();
        // Keep the pipe open and empty, so that the server can go on talking.
        let said = std::thread::spawn(move || {
            let _ = lines.read_to_string(&mut line);
            line
        });
        (Self { process, said: Some(said) }, address)
    }

    /// Number of the process.
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    /// Ends it, and gives all that it said.
    pub(crate) fn end(mut self) -> String {
        let _ = self.process.kill();
        let _ = self.process.wait();
        self.said.take().expect("not taken before").join().expect("it reads to the end")
    }

    /// Its exit code, once it has ended.
    pub(crate) fn wait(self) -> Option<i32> {
        self.wait_and_hear().0
    }

    /// Its exit code, once it has ended, and all that it said.
    pub(crate) fn wait_and_hear(mut self) -> (Option<i32>, String) {
        let code = self.process.wait().expect("it ends").code();
        (code, self.said.take().expect("not taken before").join().expect("it reads to the end"))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_client_holds_the_recorded_states_at_every_pace() {
    for profile in Profile::ALL {
        let recorded = hashes(&fine(&["inspect", text(recording(profile)), "--format", "csv"]));
        for pace in [&["--pace", "fast"][..], &["--pace", "step"], &["--pace", "wall", "--speed", "2"]] {
            let mut arguments = vec!["replay", text(recording(profile)), "--quiet"];
            arguments.extend(pace);
            let (server, address) = Server::start(&arguments);
            let run = psao(&["client", &address, "--format", "csv"]);
            assert_eq!(run.code, Some(0), "{pace:?}: {}", run.err);
            assert_eq!(hashes(&run.out), recorded, "{pace:?}");
            assert!(run.err.contains("end of the recording"), "{}", run.err);
            assert_eq!(server.wait(), Some(0));
        }
    }
}

#[test]
fn two_clients_and_a_start_in_the_middle() {
    for profile in Profile::ALL {
        let recorded = hashes(&fine(&["inspect", text(recording(profile)), "--format", "csv"]));
        let mut arguments = vec!["replay", text(recording(profile)), "--quiet", "--clients", "2"];
        arguments.extend(["--pace", "step", "--from", "0.08s"]);
        let (server, address) = Server::start(&arguments);
        let first = command(&["client", &address, "--format", "csv"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let second: Run = command(&["client", &address, "--format", "csv"]).output().unwrap().into();
        let first: Run = first.unwrap().wait_with_output().unwrap().into();
        for run in [first, second] {
            assert_eq!(hashes(&run.out), recorded[5..], "the keyframe at the start is made from the state");
        }
        assert_eq!(server.wait(), Some(0));
    }
}

#[test]
fn a_replayed_stream_is_recorded_as_it_was() {
    let folder = folder();
    let path = folder.path().join("again.psao");
    for profile in Profile::ALL {
        let (server, address) = Server::start(&["replay", text(recording(profile)), "--quiet"]);
        let run = psao(&["record", "--from", &address, "-o", text(&path)]);
        assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
        assert_eq!(server.wait(), Some(0));
        let listing = |path| hashes(&fine(&["inspect", text(path), "--format", "csv"]));
        assert_eq!(listing(&path), listing(recording(profile)));
        fine(&["verify", text(&path)]);
    }
}

#[test]
fn a_live_server_is_followed_and_recorded() {
    let folder = folder();
    let path = folder.path().join("live.psao");
    for profile in Profile::ALL {
        let mut arguments = vec!["serve", "--scene", "asteroids", "--fps", "20", "--profile", profile.name()];
        arguments.extend(SMALL);
        let (_server, address) = Server::start(&arguments);
        let client = command(&["client", &address, "--frames", "5"]).stdout(Stdio::piped()).spawn().unwrap();
        let run = psao(&["record", "--from", &address, "--frames", "5", "-o", text(&path)]);
        assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
        let client: Run = client.wait_with_output().unwrap().into();
        assert_eq!(client.code, Some(0), "{}", client.err);
        assert!(client.out.contains("5 frames applied"), "{}", client.out);
        fine(&["verify", text(&path)]);
    }
}

#[test]
fn what_there_is_no_time_to_trace_is_traced_later() {
    for profile in Profile::ALL {
        let mut arguments = vec!["serve", "--scene", "robot-lab", "--fps", "50", "--profile", profile.name()];
        arguments.extend(SMALL);
        arguments.extend(["--frames", "12", "--frame-time", "100us"]);
        let (server, address) = Server::start(&arguments);
        let run = psao(&["client", &address]);
        assert_eq!(run.code, Some(0), "{}", run.err);
        let (code, said) = server.wait_and_hear();
        assert_eq!(code, Some(0));
        assert!(said.contains("12 frames sent") && said.contains("points waited for rays"), "{said}");
    }
}

/// Starts a command, waits until it has printed frames, and presses Ctrl-C. Returns its exit code and the rest that it
/// prints.
#[cfg(unix)]
fn interrupted(arguments: &[&str]) -> (Option<i32>, String) {
    let mut process = command(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut out = BufReader::new(process.stdout.take().unwrap());
    for _ in 0..4 {
        out.read_line(&mut String::new()).unwrap();
    }
    interrupt(process.id());
    let mut rest = String::new();
    out.read_to_string(&mut rest).unwrap();
    (process.wait().unwrap().code(), rest)
}

#[cfg(unix)]
fn interrupt(process: u32) {
    let sent = std::process::Command::new("kill").args(["-INT", &process.to_string()]).status().unwrap();
    assert!(sent.success());
}

#[test]
#[cfg(unix)]
fn ctrl_c_ends_a_client_and_a_replay_with_their_totals() {
    let whole = text(recording(Profile::Surface));
    let (server, address) = Server::start(&["replay", whole, "--loop", "--pace", "wall"]);
    for arguments in [&["client", &address][..], &["replay", whole, "--loop"]] {
        let (code, rest) = interrupted(arguments);
        assert_eq!(code, Some(0), "{arguments:?}");
        assert!(rest.contains(" frames applied, "), "{arguments:?}: {rest}");
    }
    interrupt(server.id());
    let (code, said) = server.wait_and_hear();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("left") && !said.contains("left:"), "the client said goodbye: {said}");
}

#[test]
fn a_port_in_use_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let run = psao(&["replay", text(recording(Profile::Surface)), "--listen", &address]);
    assert_eq!(run.code, Some(5));
    assert!(run.err.contains(&address) && run.err.contains("in use"), "{}", run.err);
}

#[test]
fn peers_that_are_not_there_or_speak_something_else() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let web = std::thread::spawn(move || {
        let (mut peer, _) = listener.accept().unwrap();
        let mut some = [0; 16];
        peer.read_exact(&mut some).unwrap();
        peer.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n").unwrap();
    });
    let run = psao(&["client", &address]);
    web.join().unwrap();
    assert_eq!(run.code, Some(5), "{}", run.err);
    assert!(run.err.contains(&address), "{}", run.err);
    let run = psao(&["client", &address]);
    assert_eq!(run.code, Some(5), "the listener is gone");
    assert!(run.err.contains("nothing answers"), "{}", run.err);
}

#[test]
fn a_server_outlives_a_peer_that_sends_garbage() {
    let (server, address) = Server::start(&["replay", text(recording(Profile::Surface)), "--quiet"]);
    let mut garbage = std::net::TcpStream::connect(&address).unwrap();
    garbage.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let run = psao(&["client", &address]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    assert!(run.out.contains(&format!("{FRAMES} frames applied")), "{}", run.out);
    assert_eq!(server.wait(), Some(0));
}
