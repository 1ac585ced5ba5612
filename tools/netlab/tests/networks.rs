//! Promises of sessions on bad networks: no wrong state, recovery within `longest_recovery`, no effect on other
//! clients.
#![expect(clippy::unwrap_used, reason = "a test says what it expected by panicking")]

use std::sync::Arc;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::EncodedFrame;
use psao_netlab::{
    ClientPlan, ClientReport, Conditions, Fault, Lab, LabError, LabSettings, MILLION, Mode, Report,
    SEND_BUFFER_BYTES, SampleSource, Source, retransmission_timeout,
};
use psao_proto::{Limits, Micros, Profile, SceneTable};

const FRAME: u64 = 16_667;
const SECOND: u64 = 1_000_000;
/// All combinations of profile and mode. Profile `paper` has no patches, so it has no datagrams either.
const STREAMS: [(Profile, Mode); 3] =
    [(Profile::SURFACE, Mode::Stream), (Profile::SURFACE, Mode::Datagram), (Profile::PAPER, Mode::Stream)];

fn run(profile: Profile, seed: u64, plans: Vec<ClientPlan>, end: u64) -> Report {
    let settings = LabSettings { seed, period: Micros(FRAME) };
    let mut lab = Lab::new(SampleSource::new(profile).unwrap(), settings, plans).unwrap();
    lab.run_until(Micros(end)).unwrap();
    lab.report()
}

/// A delay of 40 ms in each direction.
fn far() -> Conditions {
    Conditions { delay: 40_000, ..Conditions::default() }
}

/// Returns the longest time that a packet takes when it is lost at most `losses` times in a row.
fn longest_delivery(plan: &ClientPlan, losses: u32) -> u64 {
    let waits: u64 = (0..losses).map(|again| retransmission_timeout(plan.round_trip(), again).0).sum();
    waits + plan.down.longest_delay().0.max(plan.up.longest_delay().0)
}

/// Returns the bounds of docs/network.md: the time from the end of a fault until a frame captured after it is applied.
/// `losses` is the number of consecutive losses of the same packet, `body` the size of the largest body.
fn longest_recovery(plan: &ClientPlan, body: u64, losses: u32) -> u64 {
    let waiting = SEND_BUFFER_BYTES as u64 + u64::from(plan.down.queue_bytes) + body;
    let drained = plan.down.serialization_delay(waiting).0;
    match plan.mode {
        // The next frame leaves behind everything that waits.
        Mode::Stream => FRAME + drained + longest_delivery(plan, losses),
        // Frames leave at intervals of `patience`; the first that arrives whole counts.
        Mode::Datagram => {
            let patience = 100_000 + 2 * (plan.round_trip().0 + 200_000);
            FRAME + drained + u64::from(1 + losses) * patience + plan.down.longest_delay().0
        }
    }
}

/// Returns the time from a reset until a frame is applied: reconnection, HELLO, ACCEPT with the scene, and a keyframe.
fn longest_rejoin(plan: &ClientPlan, body: u64, losses: u32) -> u64 {
    let flights = 3 * longest_delivery(plan, losses);
    plan.reconnect.0 + plan.round_trip().0 + flights + FRAME + plan.down.serialization_delay(body).0
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_others() {
    for (profile, mode) in STREAMS {
        let rough = Conditions { loss: 100_000, duplicate: 50_000, reorder: 50_000, jitter: 20_000, ..far() };
        let plans = vec![ClientPlan::symmetric(mode, rough); 3];
        let [first, again, other] = [5, 5, 6].map(|seed| run(profile, seed, plans.clone(), 3 * SECOND));
        assert_eq!(first, again);
        assert_ne!(first.digest, other.digest);
        assert_ne!(first.clients[0], first.clients[1], "each has chance of its own");
        assert_eq!((first.wrong_hashes, other.wrong_hashes), (0, 0));
    }
}

#[test]
fn a_client_that_joins_at_any_frame_has_the_right_state_soon() {
    for (profile, mode) in STREAMS {
        let plan = |frame: u64| ClientPlan {
            joins: Micros(frame * FRAME + 5),
            ..ClientPlan::symmetric(mode, far())
        };
        let report = run(profile, 1, (0..120).map(plan).collect(), 4 * SECOND);
        assert_eq!(report.wrong_hashes, 0);
        for (frame, client) in report.clients.iter().enumerate() {
            // Connecting, HELLO, then a keyframe with the next frame.
            let (least, first) = (4 * 40_000, client.first_frame_us.unwrap());
            assert!((least..=least + FRAME).contains(&first), "{frame}: {first}");
            assert_eq!((client.keyframes, client.requests, client.unusable), (1, 0, 0), "{frame}");
            // From then on it gets every frame except those between the keyframe and its acknowledgement.
            assert!(client.longest_gap_us <= 2 * FRAME + 80_000, "{frame}: {}", client.longest_gap_us);
        }
    }
}

/// Returns the number of consecutive losses whose probability is at most 1 in 1,000, at `share` per million.
fn losses(share: u32) -> u32 {
    let mut losses = 0;
    let mut likely = f64::from(MILLION);
    while likely > 1000.0 {
        likely *= f64::from(share) / f64::from(MILLION);
        losses += 1;
    }
    losses
}

fn assert_recovers(plan: &ClientPlan, report: &Report, client: &ClientReport, losses: u32) {
    let body = report.largest_body_bytes as u64;
    assert_eq!(report.wrong_hashes, 0);
    assert_eq!(
        (client.requests, client.unusable),
        (0, 0),
        "no network makes a keyframe necessary: {client:?}"
    );
    assert_eq!((client.unrecovered, client.recoveries_us.len()), (0, plan.faults.len()), "{client:?}");
    let mut faults = plan.faults.clone();
    faults.sort_by_key(|fault| fault.end());
    for (fault, recovery) in faults.iter().zip(&client.recoveries_us) {
        let most = match fault {
            Fault::Reset { .. } => longest_rejoin(plan, body, losses),
            _ => longest_recovery(plan, body, losses),
        };
        assert!(
            *recovery <= most,
            "{:?} at {} ppm: {fault:?} took {recovery}, not {most}",
            plan.mode,
            plan.down.loss
        );
    }
}

#[test]
fn after_stalls_and_resets_clients_are_current_within_the_bound() {
    let faults = vec![
        Fault::Stall { from: 5 * SECOND, to: 10 * SECOND },
        Fault::Reset { at: 15 * SECOND },
        Fault::Reset { at: 22 * SECOND },
    ];
    for (profile, mode) in STREAMS {
        for share in [0, 10_000, 50_000, 200_000] {
            let rough =
                Conditions { loss: share, duplicate: 10_000, reorder: 10_000, jitter: 10_000, ..far() };
            let plan = ClientPlan { faults: faults.clone(), ..ClientPlan::symmetric(mode, rough) };
            let report = run(profile, 11, vec![plan.clone(); 4], 40 * SECOND);
            for client in &report.clients {
                assert_recovers(&plan, &report, client, losses(share));
                assert_eq!((client.reconnects, client.failures), (2, 0), "{client:?}");
            }
        }
    }
}

#[test]
fn a_narrow_line_makes_frames_rarer_but_never_wrong() {
    for (profile, mode) in STREAMS {
        // Half the rate of the sample.
        let narrow = Conditions { rate: Some(2_000), queue_bytes: 4_000, ..far() };
        let report = run(profile, 3, vec![ClientPlan::symmetric(mode, narrow)], 60 * SECOND);
        let client = &report.clients[0];
        assert_eq!(report.wrong_hashes, 0);
        assert!(client.applied > 20, "{profile:?} {mode:?}: {client:?}");
        assert_eq!((client.reconnects, client.unusable), (0, 0), "{client:?}");
    }
}

#[test]
fn a_client_that_stalls_costs_bounded_memory_and_nobody_else_notices() {
    let limits = Limits::default().with_max_queue_bytes(2_000);
    for (profile, mode) in STREAMS {
        let fine = ClientPlan { limits, ..ClientPlan::symmetric(mode, far()) };
        let stalled =
            ClientPlan { faults: vec![Fault::Stall { from: 3 * SECOND, to: 28 * SECOND }], ..fine.clone() };
        let alone = run(profile, 1, vec![fine.clone(), fine.clone()], 31 * SECOND);
        let beside = run(profile, 1, vec![fine, stalled], 31 * SECOND);
        assert_eq!(alone.clients[0], beside.clients[0]);
        let client = &beside.clients[1];
        let most = limits.max_queue_bytes as usize + beside.largest_body_bytes;
        assert!(client.most_queued_bytes <= most, "{} of {most}", client.most_queued_bytes);
        assert_eq!((beside.wrong_hashes, client.reconnects), (0, 0));
    }
}

#[test]
fn datagrams_are_the_fresher_the_more_is_lost() {
    for (share, factor) in [(10_000, 2), (50_000, 4), (200_000, 4)] {
        let plan = |mode| ClientPlan::symmetric(mode, Conditions { loss: share, ..far() });
        let report = run(Profile::SURFACE, 2, vec![plan(Mode::Stream), plan(Mode::Datagram)], 60 * SECOND);
        let [stream, datagram] = &report.clients[..] else { unreachable!() };
        assert!(
            datagram.staleness.p99_us * factor <= stream.staleness.p99_us,
            "{share}: {:?} {:?}",
            datagram.staleness,
            stream.staleness
        );
    }
}

#[test]
fn a_client_that_lagged_before_it_took_datagrams_goes_on_after_they_are_lost() {
    let link = Conditions { loss: 71_234, ..Conditions::default() };
    let plan = ClientPlan {
        mode: Mode::Datagram,
        up: link,
        faults: vec![Fault::Blackhole { from: 3_158_371, to: 4_184_049 }],
        joins: Micros(2_957_639),
        limits: Limits::default().with_max_unacked(2),
        ..ClientPlan::default()
    };
    for seed in 0..20 {
        let report = run(Profile::SURFACE, seed, vec![plan.clone()], 10 * SECOND);
        assert_eq!((report.wrong_hashes, report.clients[0].unrecovered), (0, 0), "seed {seed}");
    }
}

/// The sample stream with a wrong state hash in one frame.
struct WrongHashSource(SampleSource);

impl Source for WrongHashSource {
    fn scene(&self) -> &Arc<SceneTable> {
        self.0.scene()
    }

    fn coder(&self) -> BlockCoder {
        self.0.coder()
    }

    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError> {
        let mut made = self.0.step()?;
        if let Some(frame) = made.as_mut().filter(|made| made.info.frame.0 == 50) {
            frame.info.hash.0 ^= 1;
        }
        Ok(made)
    }

    fn state(&self) -> Option<StateRef<'_>> {
        self.0.state()
    }
}

#[test]
fn a_state_that_is_not_the_sources_is_found() {
    let source = WrongHashSource(SampleSource::new(Profile::SURFACE).unwrap());
    let mut lab = Lab::new(source, LabSettings::default(), vec![ClientPlan::default()]).unwrap();
    lab.run_until(Micros::from_secs(2)).unwrap();
    let report = lab.report();
    // Once for the frame and once for the state after it.
    assert_eq!((report.wrong_hashes, report.clients[0].keyframes), (2, 2), "the server sends a keyframe");
}

fn conditions() -> impl Strategy<Value = Conditions> {
    let shares = (0_u32..300_000, 0_u32..200_000, 0_u32..200_000);
    let times = (0_u64..100_000, 0_u64..50_000);
    (shares, times, prop::option::weighted(0.3, 20_000_u64..1_000_000), 64_u16..1400).prop_map(
        |((loss, duplicate, reorder), (delay, jitter), rate, mtu)| Conditions {
            loss,
            duplicate,
            reorder,
            delay,
            jitter,
            rate,
            mtu,
            queue_bytes: 20_000,
        },
    )
}

/// Faults within the first ten seconds.
fn faults() -> impl Strategy<Value = Vec<Fault>> {
    let times = || (0..8 * SECOND, 1..2 * SECOND);
    let fault = prop_oneof![
        times().prop_map(|(from, lasting)| Fault::Stall { from, to: from + lasting }),
        times().prop_map(|(from, lasting)| Fault::Blackhole { from, to: from + lasting }),
        times().prop_map(|(at, _)| Fault::Reset { at }),
    ];
    prop::collection::vec(fault, 0..4)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]
    #[test]
    fn whatever_the_network_does_no_state_is_wrong_and_all_become_current(
        down in conditions(), up in conditions(), faults in faults(), stream in 0_usize..3, seed: u64,
        joins in 0..3 * SECOND, (max_queue_bytes, max_unacked) in (500_u32..100_000, 2_u32..100),
    ) {
        let (profile, mode) = STREAMS[stream];
        let limits = Limits::default().with_max_queue_bytes(max_queue_bytes).with_max_unacked(max_unacked);
        let plan = ClientPlan { mode, down, up, faults, joins: Micros(joins), reconnect: Micros(300_000), limits };
        let report = run(profile, seed, vec![plan.clone()], 60 * SECOND);
        let client = &report.clients[0];
        prop_assert_eq!(report.wrong_hashes, 0);
        prop_assert_eq!((client.unrecovered, client.recoveries_us.len()), (0, plan.faults.len()));
        prop_assert!(client.first_frame_us.is_some());
        prop_assert!(client.most_queued_bytes <= max_queue_bytes as usize + 4096);
    }
}
