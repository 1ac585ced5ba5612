//! A synthetic scene of some 100,000 points in 40 instances: a floor, and balls and boxes on it. Shadows move over
//! them, so that 1 to 2 % of the points change by the threshold in a frame. The numbers are the same on every machine:
//! no sine, no randomness.

use psao_codec::surface::RestPoint;

/// Period of the shadows, frames.
pub(crate) const PERIOD: u32 = 60;
/// Smallest difference from the clients' byte that is sent.
pub(crate) const THRESHOLD: u8 = 8;
/// Number of points of the floor, and of every other instance.
pub(crate) const FLOOR: u32 = 20_000;
pub(crate) const THING: u32 = 2050;
const THINGS: u32 = 39;
/// Edge of the floor, metres: 512 points on a square metre.
pub(crate) const EDGE: f32 = 6.25;
const SHADOWS: u32 = 5;
/// Radius of a shadow, metres.
const REACH: f32 = 0.6;

/// The sets: floor, ball, box. The first instance is the floor; the others alternate between ball and box.
pub(crate) struct Scene {
    pub(crate) sets: [Vec<RestPoint>; 3],
}

impl Scene {
    pub(crate) fn new() -> Scene {
        let floor = |n| {
            let [x, z] = spread(n);
            RestPoint { position: [x * EDGE, 0.0, z * EDGE], normal: [0.0, 1.0, 0.0], chart: 0 }
        };
        let sets = [
            (0..FLOOR).map(floor).collect(),
            (0..THING).map(|n| ball(spread(n))).collect(),
            (0..THING).map(|n| cuboid(n % 6, spread(n))).collect(),
        ];
        Scene { sets }
    }

    /// Returns set and place of every instance, metres.
    pub(crate) fn instances(&self) -> Vec<(u32, [f32; 3])> {
        let thing = |n: u32| (1 + n % 2, [0.5 + (n % 7) as f32 * 0.85, 0.4, 0.5 + (n / 7) as f32 * 0.95]);
        std::iter::once((0, [0.0; 3])).chain((0..THINGS).map(thing)).collect()
    }

    /// Returns the AO bytes of all points in every frame of a period. `orders` has, for each set, the scene points in
    /// the order of the stream.
    pub(crate) fn frames(&self, orders: &[Vec<u32>; 3]) -> Vec<Vec<u8>> {
        let mut points = Vec::new();
        for (set, [x, y, z]) in self.instances() {
            let places = orders[set as usize].iter().map(|at| self.sets[set as usize][*at as usize].position);
            points.extend(places.map(|place| [place[0] + x, place[1] + y, place[2] + z]));
        }
        let ao = |frame| (0_u32..).zip(&points).map(|(point, place)| ao(point, *place, frame)).collect();
        (0..PERIOD).map(ao).collect()
    }
}

/// Returns well-separated points of a square (M. Roberts, "The unreasonable effectiveness of quasirandom sequences",
/// 2018).
fn spread(n: u32) -> [f32; 2] {
    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step: f64| (f64::from(n + 1) * step).fract() as f32)
}

fn ball([u, v]: [f32; 2]) -> RestPoint {
    let [x, y] = [u * 2.0 - 1.0, v * 2.0 - 1.0];
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let [x, y] = [x, y].map(|axis: f32| axis - fold * axis.signum());
    let length = (x * x + y * y + z * z).sqrt();
    let normal = [x, y, z].map(|axis| axis / length);
    RestPoint { position: normal.map(|axis| axis * 0.4), normal, chart: 0 }
}

fn cuboid(face: u32, [u, v]: [f32; 2]) -> RestPoint {
    let axis = (face / 2) as usize;
    let side = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    let (mut position, mut normal) = ([0.0; 3], [0.0; 3]);
    position[axis] = 0.4 * side;
    position[(axis + 1) % 3] = u * 0.8 - 0.4;
    position[(axis + 2) % 3] = v * 0.8 - 0.4;
    normal[axis] = side;
    RestPoint { position, normal, chart: face }
}

/// Returns the AO of a point, from its surroundings, the noise of its fixed rays, and the shadows over it.
fn ao(point: u32, [x, y, z]: [f32; 3], frame: u32) -> u8 {
    let noise = (point.wrapping_mul(0x9E37_79B9) >> 24) as f32 / 255.0;
    let mut open = 205.0 + 45.0 * y.clamp(0.0, 1.0) - 20.0 * noise;
    // There and back again.
    let way = (frame * 2).abs_diff(PERIOD) as f32 / PERIOD as f32;
    for shadow in 0..SHADOWS {
        let [a, b] = spread(shadow * 3 + 1).map(|axis| axis * EDGE);
        let [c, d] = spread(shadow * 5 + 2).map(|axis| axis * 0.8 - 0.4);
        let (east, north) = (a + way * c - x, b + way * d - z);
        let far = (east * east + north * north) / (REACH * REACH);
        if far < 1.0 {
            open -= 150.0 * (0.85 + 0.3 * noise) * (1.0 - far) * (1.0 - far);
        }
    }
    open.clamp(0.0, 255.0) as u8
}
