//! `psao lab network`: a stream over bad networks, in virtual time.

use std::path::PathBuf;

use clap::ValueEnum;
use psao_netlab::{
    ClientPlan, Conditions, Fault, Lab, LabError, LabSettings, Mode, RecordingSource, Report, SampleSource,
    Source,
};
use psao_proto::Micros;
use serde::Serialize;

use crate::args::{ProfileArg, ReportFormatArg};
use crate::context::{progress, say, say_json};
use crate::error::{Exit, Failure, Outcome};
use crate::input;
use crate::output::{number, table::Figures};
use crate::quantity::{During, RateLimit, Share, Size, TimeSpan};

/// Send a stream over a simulated bad network, and measure the result
///
/// Sends a recording, or a built-in sample of a few points, to clients over a network in virtual time: minutes take
/// moments, and the same seed gives the same run. A list (0,1%,5%) runs a row for each value. The state after every applied
/// frame is compared with the source's; if one differs, the exit code is 6. docs/netlab-json.md describes the JSON.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  psao lab network --loss 5% --delay 40ms --rate 2Mbit/s --stall 3s@10s
  psao lab network a.psao --loss 0,1%,5%,20% --delay 40ms --format json")]
pub(crate) struct Args {
    /// A recording made by `psao record`, - for standard input [default: a built-in sample]
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// Profile of the built-in sample
    #[arg(long, value_enum, default_value_t = ProfileArg::Surface, conflicts_with = "file")]
    profile: ProfileArg,
    /// Number of clients, each with its own network
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=256))]
    clients: u32,
    /// How updates are sent
    #[arg(long, value_enum, value_delimiter = ',', default_value = "stream,datagram")]
    mode: Vec<ModeArg>,
    /// Share of packets lost, in each direction
    #[arg(long, value_name = "SHARE,..", value_delimiter = ',', default_value = "0")]
    loss: Vec<Share>,
    /// Share of packets that arrive twice
    #[arg(long, value_name = "SHARE", default_value = "0")]
    duplicate: Share,
    /// Share of packets delayed by up to 50 ms, so that later packets overtake them
    #[arg(long, value_name = "SHARE", default_value = "0")]
    reorder: Share,
    /// Delay of packets, in each direction
    #[arg(long, value_name = "TIME,..", value_delimiter = ',', default_value = "20ms",
        value_parser = TimeSpan::within_an_hour)]
    delay: Vec<TimeSpan>,
    /// Most additional delay, drawn for each packet
    #[arg(long, value_name = "TIME", default_value = "0", value_parser = TimeSpan::within_an_hour)]
    jitter: TimeSpan,
    /// Bandwidth in each direction, such as 2Mbit/s; none for no limit
    #[arg(long, value_name = "RATE,..", value_delimiter = ',', default_value = "none")]
    rate: Vec<RateLimit>,
    /// Size of the send queue
    #[arg(long, value_name = "SIZE", default_value_t = Size(Conditions::default().queue_bytes.into()),
        value_parser = |text: &str| Size::between(text, 0, u32::MAX.into()))]
    queue: Size,
    /// Size limit of a packet
    #[arg(long, value_name = "SIZE", default_value_t = Size(Conditions::default().mtu.into()),
        value_parser = |text: &str| Size::between(text, 0, u16::MAX.into()))]
    mtu: Size,
    /// Deliver nothing for a while and then everything: 3s@10s lasts 3 s from 10 s on; repeat it for more
    #[arg(long, value_name = "TIME@TIME")]
    stall: Vec<During>,
    /// Lose every packet for a while: 3s@10s lasts 3 s from 10 s on; repeat it for more
    #[arg(long, value_name = "TIME@TIME")]
    blackhole: Vec<During>,
    /// Break the connection at this time; repeat it for more
    #[arg(long, value_name = "TIME", value_parser = TimeSpan::within_an_hour)]
    reset: Vec<TimeSpan>,
    /// Time until a client reconnects after its connection broke
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = TimeSpan::within_an_hour)]
    reconnect: TimeSpan,
    /// Seed of all randomness; the same seed gives the same run
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Length of the run in virtual time, at most a day [default: a whole recording and 2s; 20s of the sample]
    #[arg(long, value_name = "TIME", value_parser = duration)]
    duration: Option<TimeSpan>,
    /// The older spelling of --duration
    #[arg(long, hide = true, conflicts_with = "duration", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: Option<u64>,
    /// Frames per second [default: the stream's own]
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    #[command(flatten)]
    format: ReportFormatArg,
}

/// Parses `--duration`.
fn duration(text: &str) -> Result<TimeSpan, String> {
    let time: TimeSpan = text.parse()?;
    if (1..=86_400_000_000).contains(&time.0.0) {
        Ok(time)
    } else {
        Err(format!("\"{text}\" is not a time up to 24h"))
    }
}

/// `--mode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ModeArg {
    /// Over the connection, reliable and in order
    Stream,
    /// As datagrams, unordered and without retransmission
    Datagram,
}

impl From<ModeArg> for Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Stream => Self::Stream,
            ModeArg::Datagram => Self::Datagram,
        }
    }
}

/// All that was run.
#[derive(Serialize)]
struct Document {
    schema: &'static str,
    source: String,
    seed: u64,
    period_us: u64,
    rows: Vec<Row>,
}

/// One run.
#[derive(Serialize)]
struct Row {
    mode: Mode,
    conditions: Conditions,
    faults: Vec<Fault>,
    reconnect_us: u64,
    report: Report,
}

pub(crate) fn run(args: &Args) -> Outcome {
    let plans = plans(args);
    let file = args.file.as_deref().map(input::recording).transpose()?;
    let bar = progress("running", plans.len() as u64);
    let mut document = Document {
        schema: "psao-netlab/1",
        source: String::new(),
        seed: args.seed,
        period_us: 0,
        rows: Vec::new(),
    };
    let mut left_out = 0;
    for plan in plans {
        let report = match &file {
            Some(bytes) => {
                let source = RecordingSource::new(bytes).map_err(|error| refused(args, error))?;
                let (lab, report) = play(args, source, &plan, &mut document)?;
                left_out = lab.source().left_out();
                report
            }
            None => {
                let source = SampleSource::new(args.profile.into()).map_err(|error| refused(args, error))?;
                play(args, source, &plan, &mut document)?.1
            }
        };
        let ClientPlan { mode, down: conditions, faults, reconnect: Micros(reconnect_us), .. } = plan;
        document.rows.push(Row { mode, conditions, faults, reconnect_us, report });
        bar.inc(1);
    }
    bar.finish_and_clear();
    if args.format.is_json() {
        say_json(&document)?;
    } else {
        table(args, &document)?;
    }
    let wrong: u64 = document.rows.iter().map(|row| row.report.wrong_hashes).sum();
    if wrong > 0 {
        return Err(Failure::new(
            Exit::Check,
            format_args!("{} applied with another state than the source's", number::counted(wrong, "frame")),
        ));
    }
    if left_out > 0 {
        return Err(Failure::new(
            Exit::DataLoss,
            format_args!("damage left out at {}; `psao verify` lists it", number::counted(left_out, "place")),
        ));
    }
    Ok(())
}

/// A plan for every row: all combinations of what was given as a list.
fn plans(args: &Args) -> Vec<ClientPlan> {
    let during = |kind: fn(u64, u64) -> Fault| move |span: &During| kind(span.from.0, span.to.0);
    let stalls = args.stall.iter().map(during(|from, to| Fault::Stall { from, to }));
    let blackholes = args.blackhole.iter().map(during(|from, to| Fault::Blackhole { from, to }));
    let resets = args.reset.iter().map(|TimeSpan(Micros(at))| Fault::Reset { at: *at });
    let faults: Vec<Fault> = stalls.chain(blackholes).chain(resets).collect();
    let mut plans = Vec::new();
    for rate in &args.rate {
        for TimeSpan(delay) in &args.delay {
            for Share(loss) in &args.loss {
                let conditions = Conditions {
                    loss: *loss,
                    duplicate: args.duplicate.0,
                    reorder: args.reorder.0,
                    delay: delay.0,
                    jitter: args.jitter.0.0,
                    rate: rate.bytes(),
                    queue_bytes: u32::try_from(args.queue.0).unwrap_or(u32::MAX),
                    mtu: u16::try_from(args.mtu.0).unwrap_or(u16::MAX),
                };
                plans.extend(args.mode.iter().map(|mode| ClientPlan {
                    faults: faults.clone(),
                    reconnect: args.reconnect.0,
                    ..ClientPlan::symmetric((*mode).into(), conditions)
                }));
            }
        }
    }
    plans
}

/// Runs one row to its end.
fn play<S: Source>(
    args: &Args,
    source: S,
    plan: &ClientPlan,
    document: &mut Document,
) -> Outcome<(Lab<S>, Report)> {
    let info = source.scene().info();
    let fps = args.fps.unwrap_or(f64::from(info.fps));
    if !(0.1..=10_000.0).contains(&fps) {
        return Err(Failure::usage(format_args!("--fps {fps} is not between 0.1 and 10000")));
    }
    let period = Micros((1e6 / fps).round() as u64);
    (document.source, document.period_us) = (info.name.to_string(), period.0);
    let settings = LabSettings { seed: args.seed, period };
    let plans = vec![plan.clone(); args.clients as usize];
    let mut lab = Lab::new(source, settings, plans).map_err(|error| refused(args, error))?;
    let go = |lab: &mut Lab<S>, end| lab.run_until(end).map_err(|error| refused(args, error));
    let duration = args.duration.map(|TimeSpan(micros)| micros).or(args.seconds.map(Micros::from_secs));
    match (duration, &args.file) {
        (None, Some(_)) => {
            while !lab.has_ended() {
                let next = lab.now().plus(period);
                go(&mut lab, next)?;
            }
            let settled = lab.now().plus(Micros::from_secs(2));
            go(&mut lab, settled)?;
        }
        (duration, _) => go(&mut lab, duration.unwrap_or(Micros::from_secs(20)))?,
    }
    let report = lab.report();
    Ok((lab, report))
}

fn refused(args: &Args, error: LabError) -> Failure {
    match (error, &args.file) {
        (LabError::Conditions(error), _) => Failure::usage(error),
        (error, Some(path)) => Failure::input(format_args!("{}: {error}", path.display())),
        (error, None) => Failure::new(Exit::System, error),
    }
}

fn name(mode: Mode) -> &'static str {
    match mode {
        Mode::Stream => "stream",
        Mode::Datagram => "datagram",
    }
}

fn table(args: &Args, document: &Document) -> Outcome {
    let heads = [
        "mode",
        "loss",
        "delay",
        "rate",
        "applied",
        "first ms",
        "p50 ms",
        "p95 ms",
        "p99 ms",
        "max ms",
        "gap ms",
        "recovery ms",
        "Mbit/s",
        "keyframes",
        "patches",
        "lags",
        "requests",
        "reconnects",
        "wrong",
    ];
    let mut table = Figures::new(heads);
    let millis = |micros: u64| format!("{:.0}", micros as f64 / 1e3);
    for Row { mode, conditions, report, .. } in &document.rows {
        let clients = &report.clients;
        let sum = |count: fn(&psao_netlab::ClientReport) -> u64| clients.iter().map(count).sum::<u64>();
        let most = |count: fn(&psao_netlab::ClientReport) -> u64| {
            clients.iter().map(count).max().unwrap_or_default()
        };
        let down = sum(|client| client.down.bytes) / clients.len().max(1) as u64;
        let seconds = f64::from(report.frames) * document.period_us as f64 / 1e6;
        let recovery =
            match (sum(|client| client.unrecovered), most(|client| client.recoveries_us.len() as u64)) {
                (0, 0) => "-".to_owned(),
                (0, _) => {
                    millis(most(|client| client.recoveries_us.iter().copied().max().unwrap_or_default()))
                }
                _ => "never".to_owned(),
            };
        let first =
            clients.iter().map(|client| client.first_frame_us).max_by_key(|first| first.unwrap_or(u64::MAX));
        let staleness = report.staleness;
        table.row([
            name(*mode).to_owned(),
            format!("{} %", f64::from(conditions.loss) / 10_000.0),
            millis(conditions.delay),
            conditions
                .rate
                .map_or_else(|| "none".to_owned(), |rate| format!("{} Mbit/s", rate as f64 * 8.0 / 1e6)),
            format!(
                "{}/{}",
                number::count(report.applied),
                number::count(u64::from(report.frames) * clients.len() as u64)
            ),
            first.flatten().map_or_else(|| "never".to_owned(), millis),
            millis(staleness.p50_us),
            millis(staleness.p95_us),
            millis(staleness.p99_us),
            millis(staleness.max_us),
            millis(most(|client| client.longest_gap_us)),
            recovery,
            format!("{:.3}", number::megabits(down, seconds)),
            number::count(sum(|client| client.keyframes)),
            number::count(sum(|client| client.patches)),
            number::count(sum(|client| client.lags)),
            number::count(sum(|client| client.requests)),
            number::count(sum(|client| client.reconnects)),
            report.wrong_hashes.to_string(),
        ]);
    }
    say(table)?;
    let frames = document.rows.first().map_or(0, |row| row.report.frames);
    say(format_args!(
        "{}: {} frames, {} a row, seed {}; p50 to max: age of what a client shows; times are the worst client's",
        document.source,
        number::count(frames.into()),
        number::counted(args.clients.into(), "client"),
        document.seed
    ))
}
