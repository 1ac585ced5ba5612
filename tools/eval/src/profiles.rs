//! Tests of both profiles with the same points and AO against the reference: the gain of looking points up at rest.

use std::sync::Arc;

use glam::{Quat, Vec3};
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, FrameKind, FrameMeta, StreamTime};
use psao_codec::paper::{self, PointSample, Pose, State, apply};
use psao_codec::quant::unorm;
use psao_codec::{Limits, surface};
use psao_proto::Profile;
use psao_proto::message::CameraPose;
use psao_reconstruct::reconstruct::{self, Reconstruction};
use psao_reconstruct::{GBuffer, Size, cast_view};
use psao_server::ao::{AoSettings, Scratch, Tracer};
use psao_server::bvh::Bounds;
use psao_server::points::{PlacedPoint, PointSettings, RayKey, rest_points};
use psao_server::scene::{InstanceId, Scene};
use psao_server::server::{Server, ServerSettings};
use psao_server::world::SceneBvh;
use rayon::prelude::*;

use crate::adapter::SceneView;
use crate::metric::Comparison;
use crate::reference::reference;
use crate::shapes;

/// A scene at one moment, and its points as clients of either profile hold them.
struct Both {
    world: SceneBvh,
    ao: AoSettings,
    cells: State,
    rest: surface::State,
}

impl Both {
    fn new(scene: &Arc<Scene>, time_s: f64, points: PointSettings, rays: u32) -> Self {
        let ao = AoSettings::default().with_rays(rays);
        let settings = ServerSettings::default().with_profile(Profile::PAPER).with_points(points).with_ao(ao);
        let server = Server::new(Arc::clone(scene), settings, Arc::new(|_| ())).unwrap();
        let world = SceneBvh::new(scene, &scene.pose(time_s));
        let placed: Vec<Vec<PlacedPoint>> = (0..)
            .zip(scene.instances())
            .map(|(instance, of)| {
                let posed = world.posed(InstanceId(instance)).unwrap();
                server.points().sets()[of.rest().index()]
                    .points()
                    .iter()
                    .map(|point| point.place_on(&posed))
                    .collect()
            })
            .collect();
        let values: Vec<Vec<u8>> =
            (0..).zip(&placed).map(|(instance, placed)| trace(&world, &ao, instance, placed)).collect();
        let cells = in_cells(&server, &world, &placed, &values);
        let rest = at_rest(&server, &values);
        Self { world, ao, cells, rest }
    }

    fn view(&self, pose: &CameraPose, size: Size) -> GBuffer {
        cast_view(&SceneView::new(&self.world), pose, size).unwrap()
    }

    /// Reconstructs the view from cells and from points at rest, and compares each with the reference.
    fn draw(&self, view: &GBuffer, rays: u32) -> [(Reconstruction, Comparison); 2] {
        let settings = self.ao.with_rays(rays);
        let truth = reference(&SceneView::new(&self.world), view, &settings).unwrap();
        let both = [reconstruct::cells(&self.cells, view), reconstruct::surface(&self.rest, view)];
        both.map(|found| {
            let found = found.unwrap();
            let error = Comparison::new(&truth, &found.image).unwrap();
            (found, error)
        })
    }
}

/// Returns the AO of an instance's points in their current pose.
fn trace(world: &SceneBvh, ao: &AoSettings, instance: u32, placed: &[PlacedPoint]) -> Vec<u8> {
    let tracer = Tracer::new(*ao).unwrap();
    let at = world.placement(InstanceId(instance));
    let traced = placed.par_iter().enumerate().map_init(Scratch::default, |scratch, (point, placed)| {
        let (position, normal) = (at.point(placed.position), at.direction(placed.normal));
        unorm::quantise(tracer.at(world, RayKey(point as u32), position, normal, scratch).ao)
    });
    traced.collect()
}

fn in_cells(server: &Server, world: &SceneBvh, placed: &[Vec<PlacedPoint>], values: &[Vec<u8>]) -> State {
    let layout = server.layout().as_paper().unwrap();
    let counts: Vec<u32> = values.iter().map(|values| values.len() as u32).collect();
    let mut encoder = paper::Encoder::new(Arc::clone(layout), &counts).unwrap();
    let mut id = 0;
    for (instance, (placed, values)) in (0..).zip(placed.iter().zip(values)) {
        let at = world.placement(InstanceId(instance));
        let rotation = Quat::from_mat3(&at.rotation).to_array();
        encoder.set_pose(instance, Pose { translation: at.translation.to_array(), rotation }).unwrap();
        for (placed, &ao) in placed.iter().zip(values) {
            let [local, normal] = [placed.position, placed.normal].map(|v| v.to_array());
            encoder.put(id, &PointSample { local, normal, ao }).unwrap();
            id += 1;
        }
    }
    let meta =
        FrameMeta { kind: FrameKind::Key, frame: FrameIndex(0), time: StreamTime(0), changed_points: id };
    let frame = encoder.finish(meta, BlockCoder::Stored).unwrap();
    let mut state = State::new(Arc::clone(layout));
    apply(&mut state, &frame.body, &Limits::default()).unwrap();
    state
}

fn at_rest(server: &Server, values: &[Vec<u8>]) -> surface::State {
    let scene = server.world().scene();
    let sets = (0..).zip(server.points().sets()).map(|(number, set)| {
        let points = rest_points(scene, server.points(), number);
        let bounds = Bounds::around(points.iter().map(|point| point.position.into()));
        let step = set.radius() / 16.0;
        let layout = surface::SetLayout {
            origin: bounds.min().to_array(),
            step,
            extent: (bounds.size() / step).to_array().map(|axis| axis as u32 + 1),
            normal_bits: 4,
            charts: scene.rests()[number].charts().count(true),
            levels: surface::Levels::default(),
            points: points.len() as u32,
            kernel_radius: 2.8 * set.radius(),
            digest: surface::GeometryDigest::default(),
        };
        surface::Geometry::round(layout, &points)
    });
    let sets: Vec<surface::RoundedGeometry> = sets.collect();
    let members = scene.instances().iter().map(|of| surface::Member { set: of.rest().index() as u32 });
    let layouts = sets.iter().map(|rounded| *rounded.geometry.layout()).collect();
    let layout = surface::Layout::new(layouts, members.collect(), &Limits::default()).unwrap();
    let ordered =
        scene.instances().iter().zip(values).flat_map(|(of, values)| {
            sets[of.rest().index()].order.iter().map(|&point| values[point as usize])
        });
    let values: Vec<u8> = ordered.collect();
    let geometry = sets.into_iter().map(|rounded| Arc::new(rounded.geometry)).collect();
    surface::State::from_parts(Arc::new(layout), geometry, &values)
}

#[test]
fn points_at_rest_are_as_good_as_paper_on_a_still_scene() {
    let lists = [shapes::floor(2.0), shapes::cube(Vec3::new(0.0, 0.3, 0.0), 0.3)];
    let scene = Arc::new(Scene::from_triangles("cube on floor", &lists, 0.6).unwrap());
    let both =
        Both::new(&scene, 0.0, PointSettings::default().with_per_m2(512.0).with_minimum(64).with_seed(1), 64);
    let pose = CameraPose {
        eye: [1.1, 1.2, 1.6],
        target: [0.0, 0.2, 0.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 50.0,
        aspect: 1.5,
    };
    let view = both.view(&pose, Size::new(96, 64).unwrap());
    let [(cells, cells_error), (rest, rest_error)] = both.draw(&view, 256);
    assert!(rest_error.psnr >= cells_error.psnr, "{rest_error:?} {cells_error:?}");
    assert!(rest_error.psnr > 27.0, "{rest_error:?}");
    assert!(
        rest.statistics.unsupported <= cells.statistics.unsupported,
        "{:?} {:?}",
        rest.statistics,
        cells.statistics
    );
}

#[test]
fn points_at_rest_are_better_than_cells_where_bodies_walk() {
    let scene = Arc::new(Scene::load("colonnade").unwrap());
    let both =
        Both::new(&scene, 0.7, PointSettings::default().with_per_m2(64.0).with_minimum(256).with_seed(1), 32);
    let view = both.view(&scene.camera(0.7), Size::new(160, 90).unwrap());
    let [(cells, cells_error), (rest, rest_error)] = both.draw(&view, 64);
    assert!(rest_error.psnr > cells_error.psnr, "{rest_error:?} {cells_error:?}");
    assert!(
        rest.statistics.unsupported <= cells.statistics.unsupported,
        "{:?} {:?}",
        rest.statistics,
        cells.statistics
    );
    assert!(rest.statistics.unsupported_share() < 0.02, "{:?}", rest.statistics);
}
