//! The command line itself: verbs, help, quantities, formats, standard input and output.

use std::io::Write as _;
use std::process::{Output, Stdio};

use crate::bad_input::refuses;
use crate::{Profile, Run, SMALL, command, fine, folder, psao, recording, text};

/// Runs the command with `input` on standard input.
fn fed(arguments: &[&str], input: &[u8]) -> Output {
    let mut child = command(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("psao starts");
    child.stdin.take().expect("a pipe").write_all(input).expect("psao reads");
    child.wait_with_output().expect("psao ends")
}

/// As [`fed`], with the output as text, for runs that must succeed.
fn fed_fine(arguments: &[&str], input: &[u8]) -> Run {
    let run: Run = fed(arguments, input).into();
    assert_eq!(run.code, Some(0), "psao {arguments:?}: {}{}", run.out, run.err);
    run
}

#[test]
fn old_names_work_and_say_the_new_one() {
    for (old, new) in [
        (&["stress", "--only", "no such case"][..], "psao lab stress"),
        (&["evaluate", "no-such-scene", "--methods", "none"], "psao lab sweep"),
        (&["compare-profiles", "--scene", "no-such-scene"], "psao lab profiles"),
        (&["compare-budgets", "--scene", "no-such-scene"], "psao lab budgets"),
        (&["needs", "no-such-scene"], "psao lab needs"),
        (&["netlab", "/nowhere/a.psao"], "psao lab network"),
    ] {
        let run = psao(old);
        let (note, rest) = run.err.split_once('\n').unwrap();
        assert!(note.contains(&format!("is now `{new}`")), "{old:?}: {note}");
        assert!(run.code == Some(2) || run.code == Some(3), "{old:?}: {:?}", run.code);
        assert!(rest.starts_with("psao: ") && rest.lines().count() == 1, "{rest}");
    }
    let run = psao(&["bench", "rays", "--help"]);
    assert!(run.code == Some(0) && run.out.contains("psao lab rays") && run.err.contains("`psao lab`"));
}

#[test]
fn help_is_grouped_and_each_command_has_examples() {
    let help = fine(&["--help"]);
    for heading in [
        "First steps:",
        "Make and play streams:",
        "Look into recordings:",
        "Edit recordings:",
        "Experiments:",
    ] {
        assert!(help.contains(heading), "{help}");
    }
    for code in 0..=6 {
        assert!(help.contains(&format!("  {code}  ")), "exit code {code}: {help}");
    }
    for old in ["evaluate", "netlab", "compare-"] {
        assert!(!help.contains(old), "{old} is hidden: {help}");
    }
    assert!(fine(&["record", "--help"]).contains("Examples:"));
    assert!(fine(&["help", "lab", "network"]).contains("Examples:"));
    refuses(&["fly"], 2, &["fly"]);
    refuses(&["lab"], 2, &["sweep", "network"]);
    refuses(&["record", "-o", "x.psao"], 2, &["--scene", "--from"]);
    // One spelling for the scene in all of `lab`; the older one works.
    refuses(&["lab", "needs", "--scene", "no-such-scene"], 3, &["no-such-scene"]);
    refuses(&["lab", "needs", "no-such-scene"], 3, &["no-such-scene"]);
    refuses(&["lab", "needs"], 2, &["--scene"]);
}

/// All commands, as words.
const COMMANDS: [&str; 24] = [
    "demo",
    "scenes",
    "keys",
    "record",
    "serve",
    "replay",
    "client",
    "inspect",
    "reconstruct",
    "verify",
    "cut",
    "cat",
    "recover",
    "lab",
    "lab sweep",
    "lab profiles",
    "lab budgets",
    "lab needs",
    "lab stress",
    "lab rays",
    "lab network",
    "completions",
    "man",
    "",
];

#[test]
fn help_fits_a_terminal_of_80_columns() {
    for words in COMMANDS {
        for option in ["-h", "--help"] {
            let arguments: Vec<&str> = words.split_whitespace().chain([option]).collect();
            let run: Run = command(&arguments).env("COLUMNS", "80").output().unwrap().into();
            assert_eq!(run.code, Some(0), "{words}: {}", run.err);
            for line in run.out.lines() {
                assert!(line.chars().count() <= 80, "psao {words} {option}: {line}");
            }
        }
    }
}

#[test]
fn options_of_long_lists_stand_under_headings() {
    for (words, headings) in [
        ("record", &["Network:", "Stream:", "Points and rays:", "Cache of points:"][..]),
        ("serve", &["Network:", "Stream:", "Points and rays:", "Cache of points:"]),
        ("demo", &["Stream:", "Points and rays:", "Cache of points:"]),
        ("replay", &["Network:"]),
        ("client", &["Network:"]),
        ("lab sweep", &["Values to sweep, with commas:", "Cache of points:"]),
    ] {
        let arguments: Vec<&str> = words.split_whitespace().chain(["--help"]).collect();
        let help = fine(&arguments);
        for heading in headings {
            assert!(help.lines().any(|line| line == *heading), "{words}: {heading} {help}");
        }
    }
}

#[test]
fn shells_and_man_get_what_they_need() {
    for shell in ["bash", "zsh", "fish"] {
        let script = fine(&["completions", shell]);
        assert!(script.contains("reconstruct") && script.contains("network"), "{shell}");
        assert!(!script.contains("netlab"), "{shell}");
    }
    refuses(&["completions", "teletype"], 2, &["teletype"]);
    assert!(fine(&["man"]).contains(".TH psao 1"));
    let folder = folder();
    let pages = folder.path().join("man1");
    fine(&["man", "-o", text(&pages)]);
    for page in ["psao.1", "psao-record.1", "psao-lab-network.1"] {
        let page = std::fs::read_to_string(pages.join(page)).unwrap();
        assert!(page.contains(".TH"), "{page}");
    }
}

#[test]
fn a_plain_number_is_no_quantity_in_any_option() {
    let whole = text(recording(Profile::Surface));
    let serve = ["serve", "--scene", "colonnade"];
    for (arguments, says) in [
        (&["replay", whole, "--from", "2.5"][..], "2.5ms or 2.5s"),
        (&["cut", whole, "--from", "1", "-o", "x.psao"], "1ms or 1s"),
        (&[&serve[..], &["--frame-time", "20"]].concat(), "20ms or 20s"),
        (&[&serve[..], &["--frame-time", "1h"]].concat(), "1000s"),
        (&[&serve[..], &["--record-buffer", "64"]].concat(), "64MiB"),
        (&[&serve[..], &["--record-buffer", "1kB"]].concat(), "1MiB to 64GiB"),
        (&[&serve[..], &["--budget", "500"]].concat(), "500kbit/s"),
        (&[&serve[..], &["--cache-size", "1"]].concat(), "1MiB"),
        (&["lab", "network", "--jitter", "5"], "5ms or 5s"),
        (&["lab", "network", "--loss", "1"], "1% or 100%"),
        (&["lab", "network", "--duration", "25h"], "24h"),
        (&["lab", "network", "--duration", "1s", "--seconds", "1"], "--seconds"),
        (&["lab", "budgets", "--scene", "colonnade", "--shares", "2.5%"], "whole number of percent"),
    ] {
        refuses(arguments, 2, &[says]);
    }
}

#[test]
fn quantities_mean_the_same_in_either_spelling() {
    let run = |options: &[&str]| {
        let head = ["lab", "network", "--mode", "stream", "--format", "json", "--duration", "1s"];
        fine(&[&head[..], options].concat())
    };
    let one = run(&["--loss", "5%", "--rate", "500kbit/s", "--delay", "40ms", "--mtu", "1200B"]);
    let other = run(&["--loss", "0.05", "--rate", "0.5Mbit", "--delay", "0.04s", "--mtu", "1.2kB"]);
    assert_eq!(one, other);
    let head = ["lab", "network", "--mode", "stream", "--json", "--seconds", "1"];
    let old = fine(
        &[&head[..], &["--loss", "5", "--rate", "500kbit", "--delay", "40ms", "--mtu", "1200B"]].concat(),
    );
    assert_eq!(old, one);
    fine(&["replay", text(recording(Profile::Surface)), "--pace", "wall", "--rate", "50", "--quiet"]);
}

#[test]
fn every_result_is_json_by_the_same_option() {
    let whole = text(recording(Profile::Surface));
    for arguments in [&["inspect", whole][..], &["scenes", "colonnade"], &["verify", whole]] {
        let by_format = fine(&[arguments, &["--format", "json"]].concat());
        let _: serde_json::Value = serde_json::from_str(&by_format).unwrap();
        assert_eq!(fine(&[arguments, &["--json"]].concat()), by_format, "the older spelling");
        refuses(&[arguments, &["--format", "csv", "--json"]].concat(), 2, &["--json"]);
    }
    refuses(&["lab", "network", "--format", "csv"], 2, &["table", "json"]);
    let csv = fine(&["verify", whole, "--format", "csv"]);
    assert!(csv.starts_with("check,result,found\n") && csv.lines().count() == 12, "{csv}");
}

#[test]
fn standard_input_and_output_stand_for_files() {
    let folder = folder();
    let path = recording(Profile::Surface);
    let bytes = std::fs::read(path).unwrap();
    let place = |name: &str| folder.path().join(name);

    // In.
    for arguments in
        [&["inspect", "-", "--format", "csv"][..], &["verify", "-"], &["replay", "-", "--format", "csv"]]
    {
        let named: Vec<&str> =
            arguments.iter().map(|word| if *word == "-" { text(path) } else { word }).collect();
        assert_eq!(fed_fine(arguments, &bytes).out, fine_out(&named), "{arguments:?}");
    }
    refuses_fed(&["inspect", "-"], b"something else");

    // Out: the file's bytes and nothing else.
    let file = place("cut.psao");
    fine(&["cut", text(path), "--from-frame", "4", "-o", text(&file)]);
    let cut = fed(&["cut", "-", "--from-frame", "4", "-o", "-"], &bytes);
    assert!(cut.status.success() && cut.stdout == std::fs::read(&file).unwrap());
    assert!(String::from_utf8_lossy(&cut.stderr).contains("8 frames"));
    let whole = fed(&["recover", "-", "-o", "-"], &bytes).stdout;
    assert_eq!(fed(&["cat", "-", "-o", "-"], &whole).stdout, whole);

    let file = place("record.psao");
    let record = |output: &str| {
        let head = ["record", "--scene", "colonnade", "--frames", "3", "-o", output];
        command(&[&head[..], &SMALL].concat()).output().unwrap()
    };
    assert!(record(text(&file)).status.success());
    for output in ["-", "/dev/stdout"] {
        let streamed = record(output);
        assert!(streamed.status.success() && streamed.stdout == std::fs::read(&file).unwrap(), "{output}");
        assert!(String::from_utf8_lossy(&streamed.stderr).contains("wrote to standard output: 3 frames"));
    }

    let picture = place("a.png");
    let draw = ["reconstruct", text(path), "--frame", "3", "--size", "16x9", "-o"];
    fine(&[&draw[..], &[text(&picture)]].concat());
    let drawn = command(&[&draw[..], &["-"]].concat()).output().unwrap();
    assert!(drawn.status.success() && drawn.stdout == std::fs::read(&picture).unwrap());
    refuses(&[&draw[..], &["-", "--reference"]].concat(), 2, &["one picture"]);
    refuses(&[&draw[..], &["-", "--format", "json"]].concat(), 2, &["one picture"]);

    let plot = fine(&["inspect", text(path), "--plot", "-"]);
    assert!(plot.starts_with("<svg") && plot.ends_with("</svg>\n"), "{plot}");
}

#[test]
fn a_reader_that_has_enough_ends_the_command_quietly() {
    let path = text(recording(Profile::Surface));
    let record = ["record", "--scene", "colonnade", "--frames", "3", "-o", "-"];
    for arguments in
        [&[&record[..], &SMALL].concat()[..], &["inspect", path], &["cut", path, "--from", "0", "-o", "-"]]
    {
        let mut child = command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let run: Run = child.wait_with_output().unwrap().into();
        assert_eq!((run.code, run.err.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

/// Standard output of a run that must succeed, whatever it says on standard error.
fn fine_out(arguments: &[&str]) -> String {
    let run = psao(arguments);
    assert_eq!(run.code, Some(0), "psao {arguments:?}: {}{}", run.out, run.err);
    run.out
}

/// Expects exit code 3 for an input.
fn refuses_fed(arguments: &[&str], input: &[u8]) {
    let run: Run = fed(arguments, input).into();
    assert_eq!(run.code, Some(3), "psao {arguments:?}: {}{}", run.out, run.err);
}
