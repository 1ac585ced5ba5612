//! Fixed sets of ray directions, cosine-weighted over the hemisphere around +Z.
//!
//! A point always uses the same set with the same rotation about its normal, so the AO of a still scene is
//! bit-identical in all frames. Each set is a Hammersley set, shifted on the torus by its own random offset and
//! projected from the disk (Malley's method). So every ray has the same weight. The rays are sorted into groups of
//! eight that point in similar directions.

use fearless_simd::{Level, dispatch};
use glam::{Mat3, Vec3};
use psao_codec::memory;

use crate::bvh::{LANES, PACKET_GROUPS, Packed, Packed3, SPREAD_SLACK};
use crate::points::RayKey;
use crate::random::{Random, mix, substream, unit};

/// Number of precomputed sets.
const RAY_SETS: u64 = 64;

/// Cosine of the largest half angle of a cone.
const MIN_CONE_COSINE: f32 = 1e-3;

/// One set of rays, in groups of eight.
#[derive(Clone, Debug)]
pub(crate) struct SampleSet {
    rays: usize,
    /// Directions by group. Lanes past the last ray repeat it.
    pub(crate) groups: Vec<Packed3>,
    /// Cones around the groups. Lanes past the last group are unused.
    cones: Vec<Cones>,
}

/// Cones that contain the rays of eight groups, one group per lane.
#[derive(Clone, Debug)]
pub(super) struct Cones {
    /// Unit axes.
    pub(super) axes: Packed3,
    /// Largest distance of a direction from the axis, plus [`SPREAD_SLACK`].
    pub(super) spread: Packed,
    /// Cosine (above 0) and sine of the half angle, which is slightly wider than the rays. With a sine above 1 the
    /// cone contains everything.
    pub(super) cos: Packed,
    pub(super) sin: Packed,
}

/// All sets for one seed and number of rays.
#[derive(Clone, Debug)]
pub(crate) struct SampleSets {
    seed: u64,
    sets: Vec<SampleSet>,
}

/// A set and its rotation about the normal.
pub(crate) struct PointRays<'a> {
    pub(crate) set: &'a SampleSet,
    pub(crate) cos: f32,
    pub(crate) sin: f32,
}

impl SampleSets {
    /// Computes the sets for `rays` (at least 1) rays per point.
    pub(crate) fn new(rays: u32, seed: u64) -> Self {
        Self { seed, sets: (0..RAY_SETS).map(|set| SampleSet::new(rays, substream(seed, set))).collect() }
    }

    /// Returns the bytes held on the heap.
    pub(super) fn heap_bytes(&self) -> usize {
        let set = |set: &SampleSet| memory::list(&set.groups) + memory::list(&set.cones);
        memory::list(&self.sets) + self.sets.iter().map(set).sum::<usize>()
    }

    /// Returns the rays of a point.
    pub(crate) fn of(&self, key: RayKey) -> PointRays<'_> {
        let hash = mix(self.seed ^ mix(u64::from(key.0).wrapping_add(0x5EED)));
        let angle = unit(hash) * std::f32::consts::TAU;
        let set = &self.sets[(hash % RAY_SETS) as usize];
        PointRays { set, cos: libm::cosf(angle), sin: libm::sinf(angle) }
    }
}

impl PointRays<'_> {
    /// Returns the axes of the set after its rotation about the normal and `rotation`.
    #[inline(always)]
    pub(super) fn axes(&self, rotation: &Mat3) -> [Vec3; 3] {
        let Mat3 { x_axis: x, y_axis: y, z_axis: z } = *rotation;
        [x * self.cos + y * self.sin, y * self.cos - x * self.sin, z]
    }

    /// Returns the directions of all rays after `rotation`, bit-identical to those of a packet.
    pub(super) fn directions(&self, rotation: &Mat3) -> Vec<Vec3> {
        let [x, y, z] = self.axes(rotation);
        let turned = |group: &Packed3| dispatch!(Level::baseline(), simd => Packed3::from(group.load(simd).rotated(x, y, z)));
        let all =
            self.set.groups.iter().map(turned).flat_map(|group| (0..LANES).map(move |lane| group.at(lane)));
        all.take(self.set.rays).collect()
    }

    /// Returns the number of packets that the rays fill.
    pub(super) fn chunks(&self) -> usize {
        self.set.groups.len().div_ceil(PACKET_GROUPS)
    }

    /// Returns the directions of one packet, by group.
    #[inline(always)]
    pub(super) fn groups(&self, chunk: usize) -> &[Packed3] {
        let groups = &self.set.groups;
        &groups[chunk * PACKET_GROUPS..groups.len().min((chunk + 1) * PACKET_GROUPS)]
    }

    /// Returns the cones of one packet, eight groups each.
    #[inline(always)]
    pub(super) fn cones(&self, chunk: usize) -> &[Cones] {
        const CONES: usize = PACKET_GROUPS / LANES;
        let cones = &self.set.cones;
        &cones[chunk * CONES..cones.len().min((chunk + 1) * CONES)]
    }

    /// Returns the number of padding lanes in the last group of a packet.
    pub(super) fn padding(&self, chunk: usize) -> usize {
        if chunk + 1 == self.chunks() { self.set.groups.len() * LANES - self.set.rays } else { 0 }
    }
}

impl SampleSet {
    fn new(rays: u32, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let shift = [random.unit(), random.unit()];
        let mut directions: Vec<Vec3> = (0..rays)
            .map(|i| {
                let u = fraction((i as f32 + 0.5) / rays as f32 + shift[0]);
                let v = fraction(unit(u64::from(i.reverse_bits()) << 32) + shift[1]);
                let (radius, angle) = (u.sqrt(), v * std::f32::consts::TAU);
                Vec3::new(radius * libm::cosf(angle), radius * libm::sinf(angle), (1.0 - u).max(0.0).sqrt())
                    .normalize()
            })
            .collect();
        let groups = directions.len().div_ceil(LANES);
        sort_into_groups(&mut directions, groups);
        Self::from_sorted(&directions)
    }

    fn from_sorted(directions: &[Vec3]) -> Self {
        let lanes = |group: &[Vec3]| Packed3::from_fn(|i| group[i.min(group.len() - 1)]);
        let groups: Vec<Packed3> = directions.chunks(LANES).map(lanes).collect();
        let cones = groups.chunks(LANES).map(Cones::around).collect();
        Self { rays: directions.len(), groups, cones }
    }

    /// Returns the number of rays in the set, without padding.
    #[cfg(test)]
    pub(crate) fn rays(&self) -> usize {
        self.rays
    }
}

impl Cones {
    /// Computes the cones around at most eight groups.
    fn around(groups: &[Packed3]) -> Self {
        let axes: Vec<Vec3> = groups.iter().map(axis).collect();
        let axis = |i: usize| axes.get(i).copied().unwrap_or(Vec3::Z);
        let rays =
            |i: usize| groups.get(i).into_iter().flat_map(|group| (0..LANES).map(|lane| group.at(lane)));
        let cos = Packed::from_fn(|i| rays(i).map(|d| d.dot(axis(i))).fold(1.0, f32::min) - 1e-5);
        let spread = |i: usize| rays(i).map(|d| d.distance(axis(i))).fold(0.0, f32::max) + SPREAD_SLACK;
        // Near a right angle the half angle is unreliable: the cone then contains everything.
        let narrow = |i: usize| Some(cos.array()[i]).filter(|&cos| cos > MIN_CONE_COSINE);
        Self {
            axes: Packed3::from_fn(axis),
            spread: Packed::from_fn(spread),
            sin: Packed::from_fn(|i| narrow(i).map_or(1e30, |cos| (1.0 - cos * cos).sqrt())),
            cos: Packed::from_fn(|i| narrow(i).unwrap_or(MIN_CONE_COSINE)),
        }
    }
}

/// Returns the approximate centre of a group's directions, which minimises the largest distance to them (Badoiu and
/// Clarkson 2003, "Smaller core-sets for balls").
fn axis(group: &Packed3) -> Vec3 {
    let rays = || (0..LANES).map(|lane| group.at(lane));
    let mut axis = rays().sum::<Vec3>() / LANES as f32;
    for step in 2..34 {
        let farther = |a: &Vec3, b: &Vec3| a.distance_squared(axis).total_cmp(&b.distance_squared(axis));
        let farthest = rays().max_by(farther).unwrap_or(axis);
        axis += (farthest - axis) / step as f32;
    }
    axis.normalize_or(Vec3::Z)
}

fn fraction(value: f32) -> f32 {
    value - value.floor()
}

/// Sorts directions so that every eight consecutive ones are close together. Splits recursively along the wider axis
/// of the disk, at whole groups.
fn sort_into_groups(directions: &mut [Vec3], groups: usize) {
    if groups <= 1 {
        return;
    }
    let spread = |axis: usize| {
        let values = directions.iter().map(|d| d[axis]);
        values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
    };
    let axis = usize::from(spread(1) > spread(0));
    directions.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
    let left = groups / 2;
    let (low, high) = directions.split_at_mut(left * LANES);
    sort_into_groups(low, left);
    sort_into_groups(high, groups - left);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directions(set: &SampleSet) -> Vec<Vec3> {
        let all = set.groups.iter().flat_map(|g| (0..LANES).map(|i| g.at(i)));
        all.take(set.rays()).collect()
    }

    #[test]
    fn directions_are_unit_and_follow_the_cosine() {
        let sets = SampleSets::new(192, 7);
        let mut mean = Vec3::ZERO;
        for set in &sets.sets {
            let all = directions(set);
            assert_eq!((set.rays(), all.len()), (192, 192));
            assert!(all.iter().all(|d| d.z >= 0.0 && (d.length() - 1.0).abs() < 1e-6));
            // The mean cosine of a cosine-weighted hemisphere is 2/3; each stratified set alone comes close.
            let cosine = all.iter().map(|d| d.z).sum::<f32>() / 192.0;
            assert!((cosine - 2.0 / 3.0).abs() < 0.01, "{cosine}");
            mean += all.iter().copied().sum::<Vec3>() / (192.0 * RAY_SETS as f32);
        }
        assert!(mean.truncate().length() < 0.01, "{mean}");
    }

    #[test]
    fn groups_point_roughly_the_same_way() {
        for (rays, least) in [(192, 0.85), (1000, 0.95)] {
            for set in &SampleSets::new(rays, 1).sets {
                let cosine = |group: &Packed3| {
                    let axis = (0..LANES).map(|i| group.at(i)).sum::<Vec3>().normalize();
                    (0..LANES).map(|i| group.at(i).dot(axis)).fold(1.0, f32::min)
                };
                let mean = set.groups.iter().map(cosine).sum::<f32>() / set.groups.len() as f32;
                assert!(mean > least, "{rays} rays: {mean}");
            }
        }
    }

    #[test]
    fn cones_hold_their_rays() {
        for rays in [1, 3, 8, 20, 192, 1000] {
            for set in &SampleSets::new(rays, 4).sets {
                for (group, rays) in set.groups.iter().enumerate() {
                    let (cones, lane) = (&set.cones[group / LANES], group % LANES);
                    let axis = cones.axes.at(lane);
                    let [spread, cos, sin] =
                        [&cones.spread, &cones.cos, &cones.sin].map(|all| all.array()[lane]);
                    assert!(cos > 0.0 && sin > 0.0);
                    for ray in (0..LANES).map(|ray| rays.at(ray)) {
                        assert!(ray.distance(axis) < spread);
                        assert!(ray.dot(axis) > cos || sin > 1.0);
                    }
                }
                assert_eq!(set.cones.len(), set.groups.len().div_ceil(LANES));
            }
        }
        // No narrow cone contains rays all around the horizon.
        let around = Packed3::from_fn(|i| [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y][i % 4]);
        assert!(Cones::around(&[around]).sin.array()[0] > 1.0);
    }

    #[test]
    fn a_point_always_gets_the_same_rays_and_points_differ() {
        let (a, b) = (SampleSets::new(16, 3), SampleSets::new(16, 3));
        assert_eq!(a.of(RayKey(5)).cos.to_bits(), b.of(RayKey(5)).cos.to_bits());
        assert_eq!(a.of(RayKey(5)).set.groups[0].x, b.of(RayKey(5)).set.groups[0].x);
        assert_ne!(a.of(RayKey(5)).cos.to_bits(), a.of(RayKey(6)).cos.to_bits());
        assert_ne!(a.of(RayKey(5)).cos.to_bits(), SampleSets::new(16, 4).of(RayKey(5)).cos.to_bits());
    }
}
