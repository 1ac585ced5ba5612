//! A traced scene over bad networks. Its frames are larger than those of the sample in the lab's own tests.

use std::sync::Arc;

use psao_codec::StateRef;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::EncodedFrame;
use psao_netlab::{ClientPlan, Conditions, Fault, Lab, LabError, LabSettings, Mode, Source};
use psao_proto::{Micros, Profile, SceneTable};
use psao_server::scene::Scene;
use psao_server::server::Server;

use psao_tests::{fast_settings, server, step};

/// A source that traces a scene.
struct TracedSource {
    scene: Arc<SceneTable>,
    server: Server,
    coder: BlockCoder,
    next: u32,
}

impl TracedSource {
    fn new(profile: Profile) -> Self {
        let scene = Arc::new(Scene::load("robot-lab").unwrap());
        let settings = fast_settings(&scene, 2).with_profile(profile);
        let coder = settings.coder;
        let server = server(&scene, settings).unwrap();
        Self { scene: Arc::clone(server.table()), server, coder, next: 0 }
    }
}

impl Source for TracedSource {
    fn scene(&self) -> &Arc<SceneTable> {
        &self.scene
    }

    fn coder(&self) -> BlockCoder {
        self.coder
    }

    fn step(&mut self) -> Result<Option<EncodedFrame>, LabError> {
        let made = step(&mut self.server, self.next).map_err(|error| LabError::Source(error.to_string()))?;
        self.next += 1;
        Ok(Some(EncodedFrame { body: made.body, info: made.info }))
    }

    fn state(&self) -> Option<StateRef<'_>> {
        (self.next > 0).then(|| self.server.state())
    }
}

#[test]
fn clients_of_a_traced_scene_are_right_and_current_on_bad_networks() {
    let faults = vec![Fault::Stall { from: 2_000_000, to: 3_000_000 }, Fault::Reset { at: 4_000_000 }];
    for profile in [Profile::PAPER, Profile::SURFACE] {
        // A narrow link takes about a second for the first state, of which a point of each chart is a part.
        let (modes, rate): (&[Mode], _) = match profile {
            Profile::PAPER => (&[Mode::Stream], 400_000),
            _ => (&[Mode::Stream, Mode::Datagram], 60_000),
        };
        let mut plans = Vec::new();
        for mode in modes {
            for loss in [0, 50_000] {
                let far = Conditions { loss, delay: 20_000, jitter: 5_000, ..Conditions::default() };
                let plan = ClientPlan { faults: faults.clone(), ..ClientPlan::symmetric(*mode, far) };
                let narrow = Conditions { rate: Some(rate), queue_bytes: 20_000, ..far };
                plans.push(ClientPlan { down: narrow, ..plan.clone() });
                plans.push(plan);
            }
        }
        let mut lab = Lab::new(TracedSource::new(profile), LabSettings::default(), plans).unwrap();
        lab.run_until(Micros::from_secs(9)).unwrap();
        let report = lab.report();
        assert_eq!(report.wrong_hashes, 0);
        for (number, client) in report.clients.iter().enumerate() {
            assert!(client.applied > 30, "{profile} {number}: {client:?}");
            assert_eq!((client.unrecovered, client.reconnects), (0, 1), "{profile} {number}: {client:?}");
            assert_eq!((client.requests, client.unusable), (0, 0), "{profile} {number}: {client:?}");
        }
    }
}

#[test]
fn frames_of_many_datagrams_go_over_the_connection() {
    let tiny = Conditions { loss: 50_000, delay: 40_000, mtu: 100, ..Conditions::default() };
    let plans = [Mode::Stream, Mode::Datagram].map(|mode| ClientPlan::symmetric(mode, tiny));
    let mut lab =
        Lab::new(TracedSource::new(Profile::SURFACE), LabSettings::default(), plans.into()).unwrap();
    lab.run_until(Micros::from_secs(8)).unwrap();
    let report = lab.report();
    let [stream, datagram] = &report.clients[..] else { unreachable!() };
    assert_eq!((report.wrong_hashes, datagram.requests, datagram.unusable), (0, 0, 0));
    assert!(datagram.updates > 300, "{datagram:?}");
    assert!(datagram.down.bytes < stream.down.bytes * 3 / 2, "{datagram:?} {stream:?}");
}
