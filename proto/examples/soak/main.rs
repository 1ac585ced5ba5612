//! Soak test: many clients on the loopback, some of which take no bytes. `cargo run --release -p psao-proto --example
//! soak --features tokio -- --clients 200 --stalled 20 --hz 60 --seconds 60`.
//!
//! The server runs in this process and the clients in a child process, so that their memory is measured separately.
//! Both need a file descriptor for every client (`ulimit -n`). All clients decode every frame, which dominates the time
//! on few cores; `--points` and `--coder` reduce it.

mod load;
mod source;

use std::collections::BTreeMap;
use std::process::Stdio;
use std::str::FromStr;

use load::{ClientTally, Load, Result, ServerTally, follow, listen, serve};
use psao_codec::block::BlockCoder;
use psao_proto::net::{Address, Hub};
use source::Source;

#[tokio::main]
async fn main() -> Result<()> {
    let arguments = Arguments::read()?;
    check_descriptors(arguments.load.clients);
    match &arguments.address {
        None => server(&arguments).await,
        Some(address) => {
            let seen = follow(address, arguments.load).await?;
            print_clients(&seen, arguments.load);
            Ok(())
        }
    }
}

struct Arguments {
    load: Load,
    points: u32,
    coder: BlockCoder,
    /// The server's address, in the process of the clients.
    address: Option<Address>,
}

impl Arguments {
    fn read() -> Result<Self> {
        let load = Load { clients: 200, stalled: 20, hz: 60.0, seconds: 60.0 };
        let mut read = Self { load, points: 10_000, coder: BlockCoder::Lz4, address: None };
        let mut words = std::env::args().skip(1);
        while let Some(option) = words.next() {
            let value = words.next().ok_or_else(|| format!("{option} needs a value"))?;
            match option.as_str() {
                "--clients" => read.load.clients = number(&value)?,
                "--stalled" => read.load.stalled = number(&value)?,
                "--hz" => read.load.hz = number(&value)?,
                "--seconds" => read.load.seconds = number(&value)?,
                "--points" => read.points = number(&value)?,
                "--coder" => {
                    read.coder = match value.as_str() {
                        "range" => BlockCoder::Range,
                        "zstd" => BlockCoder::default(),
                        "lz4" => BlockCoder::Lz4,
                        _ => return Err(format!("--coder {value}: range, zstd or lz4").into()),
                    }
                }
                "--connect" => read.address = Some(value.parse()?),
                _ => return Err(format!("no option {option}; see the head of the example").into()),
            }
        }
        Ok(read)
    }
}

fn number<T: FromStr>(text: &str) -> Result<T> {
    text.parse().map_err(|_| format!("{text:?} is not a number that fits").into())
}

async fn server(arguments: &Arguments) -> Result<()> {
    let load = arguments.load;
    let mut source = Source::new(arguments.points, arguments.coder, load.hz as f32)?;
    let (hub, address) = listen(&source, arguments.coder).await?;
    let mut clients = std::process::Command::new(std::env::current_exe()?)
        .args(["--connect", &address.to_string()])
        .args(["--clients", &load.clients.to_string()])
        .args(["--stalled", &load.stalled.to_string()])
        .stdin(Stdio::null())
        .spawn()?;
    println!(
        "{} clients at {address}, {} of which read nothing after their handshake",
        load.clients, load.stalled
    );
    let before = resident_kib();
    let result = serve(&hub, &mut source, load, print_progress).await;
    if result.is_err() {
        clients.kill()?;
    }
    let status = clients.wait()?;
    let served = result?;
    print_server(&served, load, before);
    if status.success() { Ok(()) } else { Err("the clients failed".into()) }
}

fn print_progress(served: &ServerTally, hub: &Hub) {
    println!(
        "{} frames; {} clients joined; {} bytes wait; server's resident memory {}",
        served.frames,
        hub.joined(),
        hub.queued_bytes(),
        mib(resident_kib())
    );
}

fn print_server(served: &ServerTally, load: Load, before: Option<u64>) {
    let ServerTally { frames, late, bytes, sent, joined, left, faults, slowest, most_queued } = served;
    println!("server: {frames} frames in {} s at {} Hz, {late} ticks late", load.seconds, load.hz);
    println!("  {:.0} bytes a body; {joined} joined, {left} left", *bytes as f64 / (*frames).max(1) as f64);
    println!(
        "  {} updates, {} patches, {} keyframes, {} times behind",
        sent.updates, sent.patches, sent.keyframes, sent.behind
    );
    println!(
        "  giving a frame to all took at most {:.2} ms; at most {most_queued} bytes waited",
        slowest.as_secs_f64() * 1e3
    );
    println!("  resident memory {} before the first frame, {} at the end", mib(before), mib(resident_kib()));
    let mut counts = BTreeMap::new();
    for fault in faults {
        *counts.entry(fault).or_insert(0) += 1;
    }
    for (fault, count) in counts {
        println!("  {count} times: {fault}");
    }
}

fn print_clients(seen: &[ClientTally], load: Load) {
    let mut rates: Vec<f64> = seen.iter().map(|one| one.per_second).collect();
    rates.sort_by(f64::total_cmp);
    let at = |share: f64| {
        rates.get(((rates.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or_default()
    };
    println!(
        "clients: {} good ones; frames a second min {:.2}, median {:.2}, max {:.2}; {} frames, {} unusable",
        load.clients - load.stalled,
        at(0.0),
        at(0.5),
        at(1.0),
        seen.iter().map(|one| one.frames).sum::<u64>(),
        seen.iter().map(|one| one.unusable).sum::<u64>()
    );
    println!("  resident memory {}", mib(resident_kib()));
    for error in seen.iter().filter_map(|one| one.error.as_ref()) {
        println!("  error: {error}");
    }
}

/// Returns the resident memory of this process, if the system provides it.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?.split_whitespace().next()?.parse().ok()
}

fn mib(kib: Option<u64>) -> String {
    kib.map_or_else(|| "unknown".to_owned(), |kib| format!("{:.1} MiB", kib as f64 / 1024.0))
}

/// Prints a warning if the system allows fewer file descriptors than there are clients.
fn check_descriptors(clients: usize) {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max open files"));
    let limit: Option<usize> = limit.and_then(|rest| rest.split_whitespace().next()?.parse().ok());
    if limit.is_some_and(|limit| limit < clients + 32) {
        eprintln!(
            "only {} file descriptors for {clients} clients: raise `ulimit -n`",
            limit.unwrap_or_default()
        );
    }
}
