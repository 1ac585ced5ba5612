//! Credentials, certificates and addresses, with whole programs.

use std::path::Path;

use crate::live::Server;
use crate::{Run, SMALL, command, fine, folder, psao, text};

/// Arguments of a small live server.
fn serve<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["serve", "--scene", "asteroids", "--fps", "20"];
    arguments.extend(SMALL);
    arguments.extend(more);
    arguments
}

fn client(address: &str, more: &[&str]) -> Run {
    let mut arguments = vec!["client", address, "--frames", "3", "--quiet"];
    arguments.extend(more);
    psao(&arguments)
}

/// What `psao keys` made, and where.
struct Keys {
    folder: tempfile::TempDir,
}

impl Keys {
    fn new() -> Self {
        let folder = folder();
        fine(&["keys", text(&folder.path().join("keys"))]);
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        text(&self.folder.path().join("keys").join(name)).to_owned()
    }

    fn token(&self) -> String {
        std::fs::read_to_string(self.path("token")).unwrap().trim().to_owned()
    }
}

#[test]
fn tls_token_and_client_certificate_are_all_needed() {
    let (keys, others) = (Keys::new(), Keys::new());
    let [cert, key, authority, token] =
        ["server.pem", "server.key", "authority.pem", "token"].map(|n| keys.path(n));
    let arguments =
        serve(&["--cert", &cert, "--key", &key, "--client-ca", &authority, "--token-file", &token]);
    let (server, address) = Server::start_at("tls:localhost:0", &arguments);
    let shown = ["--cert", &keys.path("client.pem"), "--key", &keys.path("client.key")];
    let trusts = ["--ca", &authority];
    let mut printed = Vec::new();
    let mut attempt = |more: &[&[&str]]| {
        let run = client(&address, &more.concat());
        printed.extend([run.out.clone(), run.err.clone()]);
        run
    };

    let run = attempt(&[&trusts, &shown, &["--token-file", &token]]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    let path = keys.folder.path().join("live.psao");
    let mut record = vec!["record", "--from", &address, "--frames", "3", "-o", text(&path)];
    record.extend(trusts.iter().chain(&shown));
    let run: Run = command(&record).env("PSAO_TOKEN", keys.token()).output().unwrap().into();
    assert_eq!(run.code, Some(0), "{}", run.err);
    fine(&["verify", text(&path)]);

    for (more, code, says) in [
        (
            vec![&trusts[..], &shown],
            5,
            "requires a token: ask its operator for it (CREDENTIAL) (--token-file or PSAO_TOKEN)",
        ),
        (vec![&trusts, &shown, &["--token-file", &others.path("token")]], 5, "not the server's"),
        (
            vec![&trusts, &["--token-file", &token]],
            5,
            "is missing: the server takes only clients that show one",
        ),
        (vec![&["--ca", &others.path("authority.pem")], &["--token-file", &token]], 5, "is not trusted"),
        (vec![&["--token-file", &token]], 2, "--ca"),
        (vec![&["--ca", &token]], 3, "there is no authority's certificate"),
        (vec![&["--ca", "nowhere.pem"]], 3, "nowhere.pem"),
    ] {
        let run = attempt(&more);
        assert_eq!(run.code, Some(code), "{more:?}: {}{}", run.out, run.err);
        assert!(run.err.contains(says), "{more:?}: {}", run.err);
    }
    let plain = address.trim_start_matches("tls:");
    let run = client(plain, &["--token-file", &token]);
    assert_eq!(run.code, Some(5));
    assert!(run.err.contains(&format!("connect to tls:{plain}")), "{}", run.err);

    printed.extend([run.out, run.err, server.end()]);
    for secret in [keys.token(), others.token()] {
        assert!(printed.iter().all(|text| !text.contains(&secret)), "the token was printed");
    }
    assert!(printed.iter().any(|text| text.contains("joined")), "the server's words are among them");
}

#[cfg(unix)]
#[test]
fn a_unix_socket_goes_when_the_server_is_asked_to_stop() {
    let folder = folder();
    let path = folder.path().join("psao.socket");
    let address = format!("unix:{}", text(&path));
    let (server, bound) = Server::start_at(&address, &serve(&[]));
    assert_eq!(bound, address);
    let run = client(&address, &[]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    let killed = std::process::Command::new("kill").arg(server.id().to_string()).status().unwrap();
    assert!(killed.success());
    assert_eq!(server.wait(), Some(0));
    assert!(!path.exists());
    let run = client(&address, &[]);
    assert_eq!(run.code, Some(5));
    assert!(run.err.contains("nothing answers"), "{}", run.err);
}

#[test]
fn an_address_that_others_can_reach_is_refused_unless_it_is_guarded() {
    let keys = Keys::new();
    let [cert, key, token] = ["server.pem", "server.key", "token"].map(|name| keys.path(name));
    let tls = ["--cert", &cert, "--key", &key];
    for (listen, more) in
        [("0.0.0.0:0", vec![]), ("[::]:0", vec!["--token-file", &token]), ("tls:0.0.0.0:0", tls.to_vec())]
    {
        let run = psao(&serve(&[&["--listen", listen], &more[..]].concat()));
        assert_eq!(run.code, Some(2), "{}", run.err);
        assert!(run.err.contains("can be reached from other machines"), "{}", run.err);
        assert!(run.err.contains("--open-to-everyone"), "{}", run.err);
    }
    let (open, _) = Server::start_at("0.0.0.0:0", &serve(&["--open-to-everyone"]));
    let guarded = serve(&[&tls[..], &["--token-file", &token]].concat());
    let (guarded, _) = Server::start_at("tls:0.0.0.0:0", &guarded);
    assert!(open.end().contains("serving") && guarded.end().contains("serving"));
}

#[test]
fn keys_are_secret_and_never_overwritten() {
    let keys = Keys::new();
    let before = keys.token();
    assert_eq!(before.len(), 64);
    let run = psao(&["keys", text(&keys.folder.path().join("keys"))]);
    assert_eq!(run.code, Some(3), "{}", run.err);
    assert!(run.err.contains("not overwritten"), "{}", run.err);
    assert_eq!(keys.token(), before);

    // One file in the way is enough, and then none is written.
    let other = keys.folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("client.key"), "mine").unwrap();
    assert_eq!(psao(&["keys", text(&other)]).code, Some(3));
    assert_eq!(std::fs::read_dir(&other).unwrap().count(), 1);

    #[cfg(unix)]
    for name in ["authority.key", "server.key", "client.key", "token"] {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = std::fs::metadata(keys.path(name)).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{name}");
    }
}

#[test]
fn tokens_that_are_none_are_refused_and_loose_files_warned_about() {
    let folder = folder();
    let path = folder.path().join("token");
    let run = |secret: &str| {
        std::fs::write(&path, secret).unwrap();
        loosen(&path);
        client("127.0.0.1:1", &["--token-file", text(&path)])
    };
    let short = run("only fifteen by\n");
    assert_eq!(short.code, Some(3), "{}", short.err);
    assert!(short.err.contains("16 to 256") && !short.err.contains("fifteen"), "{}", short.err);
    let good = run("just sixteen by.\n");
    assert_eq!(good.code, Some(5), "nobody is there: {}", good.err);
    assert_eq!(good.err.contains("others can read the secret"), cfg!(unix), "{}", good.err);
}

fn loosen(path: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644)).unwrap();
    }
    #[cfg(not(unix))]
    let _ = path;
}
