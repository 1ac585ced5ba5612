//! Measures the errors of the packings on a real scene, for every field of every point in some frames. For profile
//! `paper` these are the errors of points in their cells. For `surface` they are the errors of points at rest, which
//! are the same in every frame.
//!
//! ```sh
//! cargo run --release -p psao-server --example packing_errors -- colonnade 512 0 10
//! ```

use std::sync::Arc;

use glam::Vec3;
use psao_codec::block::BlockCoder;
use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_codec::paper::{self, Grid, PointFormat};
use psao_proto::Profile;
use psao_server::clock::NoClock;
use psao_server::points::{
    GeometryPrecision, PlacedPoint, PointSettings, ScenePoints, generate, order_at_rest, rest_points,
};
use psao_server::scene::{Geometry, InstanceId, PosedMesh, Scene};
use psao_server::server::{Server, ServerSettings};

type Failure = Box<dyn std::error::Error>;

/// Mean and largest error of one field.
#[derive(Default)]
struct Errors {
    sum: f64,
    count: u64,
    largest: f64,
}

impl Errors {
    fn add(&mut self, error: f64) {
        self.sum += error;
        self.count += 1;
        self.largest = self.largest.max(error);
    }

    fn text(&self) -> String {
        format!("{:.3} / {:.3}", self.sum / self.count.max(1) as f64, self.largest)
    }
}

/// Errors of the geometry in one packing.
#[derive(Default)]
struct GeometryErrors {
    millimetres: Errors,
    radii: Errors,
    degrees: Errors,
}

impl GeometryErrors {
    /// Packs a point in its cell and adds the errors. `radius` is the Poisson-disk radius of its set.
    fn add(&mut self, format: PointFormat, grid: &Grid, point: &PlacedPoint, radius: f32) {
        let located = grid.locate(point.position.to_array());
        let packed = format.unpack(format.pack(located.frac, point.normal.to_array(), 0));
        let position = Vec3::from(grid.corner(located.cell)) + Vec3::from(packed.frac) * grid.edge();
        self.add_pair((point.position, position), (point.normal, packed.normal.into()), radius);
    }

    /// Adds the errors of a position and a normal, each given before and after packing.
    fn add_pair(&mut self, position: (Vec3, Vec3), normal: (Vec3, Vec3), radius: f32) {
        let off = f64::from(position.0.distance(position.1));
        self.millimetres.add(off * 1e3);
        self.radii.add(off / f64::from(radius));
        let (was, is) = (normal.0.as_dvec3(), normal.1.as_dvec3());
        self.degrees.add(libm::atan2(was.cross(is).length(), was.dot(is)).to_degrees());
    }
}

fn main() -> Result<(), Failure> {
    let usage = "usage: packing_errors SCENE POINTS_PER_M2 FRAME...";
    let mut arguments = std::env::args().skip(1);
    let scene = Arc::new(Scene::load(&arguments.next().ok_or(usage)?)?);
    let per_m2 = arguments.next().ok_or(usage)?.parse()?;
    let points = PointSettings::default().with_per_m2(per_m2);
    let coder = BlockCoder::default();
    println!("profile surface, mean / largest");
    println!("  bits | position, mm | Poisson radii | normal, degrees | lattice, normal bits");
    let made = generate(&scene, &points, &|_, _| {})?;
    for format in PointFormat::ALL {
        let (errors, precision) = at_rest(&scene, &made, format)?;
        println!(
            "  {} | {} | {} | {} | 1/{} radius, {}",
            format.bits(),
            errors.millimetres.text(),
            errors.radii.text(),
            errors.degrees.text(),
            precision.steps,
            precision.normal_bits,
        );
    }
    let mut server = Server::new(
        Arc::clone(&scene),
        ServerSettings::default().with_profile(Profile::PAPER).with_coder(coder).with_points(points),
        Arc::new(|_| {}),
    )?;
    for frame in arguments {
        let frame: u32 = frame.parse()?;
        let time = StreamTime(u64::from(frame) * 1_000_000 / 60);
        server.step(FrameIndex(frame), time, &[], &NoClock)?;
        println!("profile paper, frame {frame}, mean / largest");
        println!("  bits | position, mm | Poisson radii | normal, degrees | AO, 255ths");
        for format in PointFormat::ALL {
            let encoder = server.paper().ok_or("the stream is not of profile paper")?;
            let places = places(&scene, &server, encoder, time, format);
            println!(
                "  {} | {} | {} | {} | {}",
                format.bits(),
                places.millimetres.text(),
                places.radii.text(),
                places.degrees.text(),
                values(encoder, format).text(),
            );
        }
    }
    Ok(())
}

/// Returns the errors of the points of every mesh at rest, in the precision that corresponds to the bits.
fn at_rest(
    scene: &Scene,
    points: &ScenePoints,
    format: PointFormat,
) -> Result<(GeometryErrors, GeometryPrecision), Failure> {
    let precision = GeometryPrecision::of_bits(format.bits() as u8).ok_or("no such packing")?;
    let kernel = 2.8;
    let mut errors = GeometryErrors::default();
    let mut ordered = points.clone();
    let geometry = order_at_rest(scene, &mut ordered, precision, kernel);
    for (set, geometry) in geometry.iter().enumerate() {
        let radius = points.sets()[set].radius();
        for (at, point) in rest_points(scene, &ordered, set).iter().enumerate() {
            let position = (point.position.into(), geometry.position(at).into());
            errors.add_pair(position, (point.normal.into(), geometry.normal(at).into()), radius);
        }
    }
    Ok((errors, precision))
}

/// Returns the errors of all points of the scene posed at `time`.
fn places(
    scene: &Arc<Scene>,
    server: &Server,
    encoder: &paper::Encoder,
    time: StreamTime,
    format: PointFormat,
) -> GeometryErrors {
    let pose = scene.pose(time.micros() as f64 * 1e-6);
    let mut geometry = Geometry::default();
    let mut errors = GeometryErrors::default();
    let layouts = encoder.state().layout().instances();
    for (index, (instance, layout)) in scene.instances().iter().zip(layouts).enumerate() {
        let set = &server.points().sets()[instance.rest().index()];
        scene.local_geometry(InstanceId(index as u32), &pose, &mut geometry);
        let mesh = PosedMesh::posed(scene, scene.rest(instance), &geometry);
        for point in set.points() {
            errors.add(format, &layout.grid, &point.place_on(&mesh), set.radius());
        }
    }
    errors
}

/// Returns the errors of the traced values. The server's own stream has 8 bits for them.
fn values(encoder: &paper::Encoder, format: PointFormat) -> Errors {
    let mut errors = Errors::default();
    let wide = encoder.state().layout().format();
    for point in encoder.state().cells().iter().flat_map(|cell| cell.points(wide)) {
        errors.add(f64::from(format.held_ao(point.ao).abs_diff(point.ao)));
    }
    errors
}
