//! Levels: which blocks of points clients get.

use psao_codec::surface::{Budget, PICTURE_ROWS, SetLayout};

use super::*;
use crate::points::PointInSet;
use crate::visibility::View;

const QUALITY: f32 = 24.0;

/// A floor of 40 m x 40 m.
fn floor() -> Arc<Scene> {
    let at = |x: f32, z: f32| Vec3::new(x * 20.0, 0.0, z * 20.0);
    let floor =
        [[at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(1.0, -1.0)]];
    Arc::new(Scene::from_triangles("floor", &[floor.to_vec()], 0.6).unwrap())
}

/// A camera over the floor that looks along it.
fn over(z: f32, ahead: f32) -> CameraPose {
    CameraPose {
        eye: [0.0, 1.7, z],
        target: [0.0, 0.0, z + ahead],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 50.0,
        aspect: 1.5,
    }
}

fn fine(quality: f32) -> ServerSettings {
    ServerSettings { quality, ..settings(Profile::SURFACE, 96.0) }
}

/// A server, and a client that holds its state.
struct Pair {
    server: Server,
    client: surface::State,
    decoder: surface::Decoder,
    frame: u32,
}

impl Pair {
    fn new(settings: ServerSettings) -> Self {
        let server = server(&floor(), settings);
        let Layout::Surface(layout) = server.layout() else { unreachable!() };
        let client = surface::State::new(Arc::clone(layout));
        Self { server, client, decoder: surface::Decoder::new(), frame: 0 }
    }

    fn step(&mut self, views: &[CameraPose]) -> StepOutput {
        let output = self.server.step(FrameIndex(self.frame), time(self.frame), views, &NoClock).unwrap();
        self.frame += 1;
        self.decoder.decode(&mut self.client, &output.body, &psao_codec::Limits::default()).unwrap();
        assert_eq!(self.client.hash(), self.server.hash());
        output
    }

    fn layout(&self) -> SetLayout {
        self.client.layout().sets()[0]
    }

    /// Points that a camera asks for at their own place: level, and whether the client has them.
    fn asked_for(&self, camera: &CameraPose) -> Vec<(u8, bool)> {
        let layout = self.layout();
        let view = View::new(camera, 1.0).unwrap();
        let pixel = 2.0 * (camera.fov_y_deg.to_radians() * 0.5).tan() / PICTURE_ROWS;
        let field = &self.server.trace.state.field;
        let place = |point: u32| field.placed().local(0)[PointInSet(point).index()].position;
        let asked = (0..layout.points).filter(|&point| {
            let distance = place(point).distance(camera.eye.into());
            let wanted = layout.level_within(QUALITY * pixel * distance);
            view.sees(place(point)) && layout.levels.of_point(point) <= wanted
        });
        let here = |point: u32| self.client.is_present(0, point as usize / BLOCK_POINTS);
        asked.map(|point| (layout.levels.of_point(point), here(point))).collect()
    }
}

#[test]
fn clients_have_what_a_camera_asks_for_and_little_else() {
    let mut pair = Pair::new(fine(QUALITY));
    let camera = over(-19.0, 6.0);
    let first = pair.step(&[camera]);
    let asked = pair.asked_for(&camera);
    assert!(asked.iter().all(|(_, here)| *here), "{:?}", asked.iter().find(|(_, here)| !here));
    let finest = pair.layout().levels.count() - 1;
    assert!(asked.iter().any(|(level, _)| *level == finest), "near the camera");
    let (present, all) = (pair.client.present_points(), u64::from(pair.layout().points));
    assert!(
        present * 3 < all * 2 && present < 3 * asked.len() as u64,
        "{present} of {all}, {} asked for",
        asked.len()
    );
    assert!(first.stats.traced < present as u32 + 64);
    // The coarsest level is here wherever the camera looks.
    let coarsest = pair.layout().levels.end(0, 0) as usize;
    assert!((0..coarsest.div_ceil(BLOCK_POINTS)).all(|block| pair.client.is_present(0, block)));
}

#[test]
fn a_camera_that_goes_on_gets_more_and_keeps_the_rest() {
    let mut pair = Pair::new(fine(QUALITY));
    pair.step(&[over(-19.0, 6.0)]);
    let before = pair.client.clone();
    let there = over(10.0, 6.0);
    pair.step(&[there]);
    assert!(pair.asked_for(&there).iter().all(|(_, here)| *here));
    let blocks = pair.client.layout().blocks();
    assert!((0..blocks).all(|block| pair.client.is_present(0, block) || !before.is_present(0, block)));
    let present = pair.client.present_points();
    assert!(present > before.present_points());
    // Back where it was, nothing new is needed.
    let back = pair.step(&[over(-19.0, 6.0)]);
    assert_eq!((pair.client.present_points(), back.stats.changed), (present, 0));
    // Two cameras get what each asks for.
    let both = [over(-5.0, 3.0), over(3.0, -3.0)];
    pair.step(&both);
    assert!(both.iter().flat_map(|camera| pair.asked_for(camera)).all(|(_, here)| here));
}

#[test]
fn without_cameras_or_levels_clients_have_all() {
    for (quality, views) in [(QUALITY, vec![]), (0.0, vec![over(-19.0, 6.0)])] {
        let mut pair = Pair::new(fine(quality));
        pair.step(&views);
        assert_eq!(pair.client.present_points(), u64::from(pair.layout().points), "quality {quality}");
    }
}

#[test]
fn a_byte_budget_is_shared_with_blocks_that_arrive() {
    let budget = Some(Budget::new(2 * 64 * 5));
    let mut pair = Pair::new(ServerSettings { budget, ..fine(QUALITY) });
    pair.step(&[over(-19.0, 6.0)]);
    let there = over(10.0, 6.0);
    let asked = |pair: &Pair| pair.asked_for(&there);
    let mut levels = Vec::new();
    while asked(&pair).iter().any(|(_, here)| !here) {
        let before = pair.client.present_points();
        let output = pair.step(&[there]);
        let arrived = pair.client.present_points() - before;
        assert!(
            (1..=5 * 64).contains(&arrived) && output.body.len() <= 640,
            "{arrived}, {} B",
            output.body.len()
        );
        let missing = asked(&pair).iter().filter(|(_, here)| !here).map(|(level, _)| *level).min();
        levels.extend(missing);
    }
    assert!(levels.len() > 3 && levels.is_sorted(), "coarse levels come first: {levels:?}");
}
