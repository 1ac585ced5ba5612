//! Streams with a byte budget.

use psao_codec::surface::Budget;

use super::*;

fn budgeted(bytes: u32, longest_age: u16) -> ServerSettings {
    let budget = Some(Budget::new(bytes).with_longest_age(longest_age));
    // Blocks that arrive would take their part of the budget.
    ServerSettings { budget, threshold: 2, quality: 0.0, ..settings(Profile::SURFACE, 24.0) }
}

/// Frame bodies of a clip that looks along the camera path.
fn bodies(
    scene: &Arc<Scene>,
    settings: ServerSettings,
    mut check: impl FnMut(&Server, &StepOutput),
) -> Vec<Vec<u8>> {
    let mut server = server(scene, settings);
    let frame = |frame: u32| {
        let views = [camera(scene, time(frame).micros() as f64 * 1e-6)];
        let output = server.step(FrameIndex(frame), time(frame), &views, &NoClock).unwrap();
        check(&server, &output);
        output.body
    };
    (0..30).map(frame).collect()
}

#[test]
fn a_budget_is_kept_and_what_it_postpones_is_counted() {
    let scene = colonnade();
    let free = bodies(&scene, ServerSettings { budget: None, ..budgeted(0, 0) }, |_, output| {
        assert_eq!(output.stats.postponed, None);
    });
    let demand = free[1..].iter().map(Vec::len).max().unwrap() as u32;
    assert!(bodies(&scene, budgeted(demand, 5), |_, _| {}) == free);
    let most = demand / 3;
    let (mut waited, mut longest) = (0, 0);
    let mut client: Option<State> = None;
    let mut decoder = Decoder::default();
    let limits = psao_codec::Limits::default();
    let half = bodies(&scene, budgeted(most, 5), |server, output| {
        let postponed = output.stats.postponed.unwrap();
        let bytes = output.body.len() as u32;
        assert_eq!(postponed.used, bytes);
        let only_forced = output.stats.changed == postponed.forced;
        assert!(bytes <= most || only_forced || output.info.kind == FrameKind::Key, "{postponed:?}");
        waited += postponed.points;
        longest = longest.max(postponed.oldest);
        let client = client.get_or_insert_with(|| State::new(server.layout()));
        decoder.decode(client, &output.body, &limits).unwrap();
        assert_eq!(client.hash(), server.hash());
    });
    assert!(waited > 0 && (1..=5).contains(&longest), "{waited} points waited, {longest} frames at most");
    assert!(half != free);
}

#[test]
fn blocks_near_the_camera_weigh_more() {
    let scene = colonnade();
    let mut server = server(&scene, budgeted(1 << 20, 5));
    let mut views = vec![camera(&scene, 0.0)];
    let mut weights = |views: &[CameraPose], frame: u32| {
        server.step(FrameIndex(frame), time(frame), views, &NoClock).unwrap();
        let encoder = server.surface().unwrap();
        let blocks = |instance| encoder.state().layout().blocks_of(instance).len();
        let instances = 0..encoder.state().layout().members().len() as u32;
        let all = instances.flat_map(|instance| {
            (0..blocks(instance)).map(move |block| encoder.weight(instance, block).unwrap())
        });
        all.collect::<Vec<u16>>()
    };
    let near = weights(&views, 0);
    assert!(near.iter().all(|weight| *weight > 0) && near.iter().max() > near.iter().min());
    views[0].eye[0] += 1e7;
    views[0].target[0] += 1e7;
    assert!(weights(&views, 1).iter().all(|weight| *weight == 1));
    assert!(weights(&[], 2).iter().all(|weight| *weight == 1));
}
