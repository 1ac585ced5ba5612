//! Fixed sets of ray directions: cosine-weighted over the hemisphere around +Z.
//!
//! A point always uses the same set and the same turn about its normal, so that a scene that stands still keeps its
//! AO to the bit. Each set is a Hammersley set, shifted on the torus by its own random offset and lifted from the
//! disk (Malley's method), so that every ray carries the same weight. Its rays are sorted into groups of eight that
//! point roughly the same way.

use glam::Vec3;

use super::bundle::GROUPS;
use crate::bvh::{LANES, Lanes3};
use crate::points::random::{Random, mix, substream, unit};

/// Number of sets that are computed ahead.
const SETS: u64 = 64;

/// One set: groups of eight rays.
#[derive(Clone, Debug)]
pub(crate) struct SampleSet {
    rays: usize,
    /// Directions by group. Lanes past the last ray repeat it.
    pub(crate) groups: Vec<Lanes3>,
}

/// All sets of one seed and ray count.
#[derive(Clone, Debug)]
pub(crate) struct SampleSets {
    seed: u64,
    sets: Vec<SampleSet>,
}

/// A set and how it is turned about the normal.
pub(crate) struct Turned<'a> {
    pub(crate) set: &'a SampleSet,
    pub(crate) cos: f32,
    pub(crate) sin: f32,
}

impl SampleSets {
    /// Computes the sets for `rays` (at least 1) rays a point.
    pub(crate) fn new(rays: u32, seed: u64) -> Self {
        Self { seed, sets: (0..SETS).map(|set| SampleSet::new(rays, substream(seed, set))).collect() }
    }

    /// The rays of a point.
    pub(crate) fn of(&self, point: u32) -> Turned<'_> {
        let hash = mix(self.seed ^ mix(u64::from(point).wrapping_add(0x5EED)));
        let angle = unit(hash) * std::f32::consts::TAU;
        let set = &self.sets[(hash % SETS) as usize];
        Turned { set, cos: libm::cosf(angle), sin: libm::sinf(angle) }
    }
}

impl Turned<'_> {
    /// How many bundles the rays fill.
    pub(super) fn chunks(&self) -> usize {
        self.set.groups.len().div_ceil(GROUPS)
    }

    /// Directions of one bundle, by group.
    #[inline(always)]
    pub(super) fn groups(&self, chunk: usize) -> &[Lanes3] {
        let groups = &self.set.groups;
        &groups[chunk * GROUPS..groups.len().min((chunk + 1) * GROUPS)]
    }

    /// Lanes of the last group of a bundle that hold no ray of their own.
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
        gather(&mut directions, groups);
        Self::from_sorted(&directions)
    }

    fn from_sorted(directions: &[Vec3]) -> Self {
        let lanes = |group: &[Vec3]| Lanes3::from_fn(|i| group[i.min(group.len() - 1)]);
        Self { rays: directions.len(), groups: directions.chunks(LANES).map(lanes).collect() }
    }

    /// Rays in the set, without the padding of the last group.
    #[cfg(test)]
    pub(crate) fn rays(&self) -> usize {
        self.rays
    }
}

fn fraction(value: f32) -> f32 {
    value - value.floor()
}

/// Sorts directions so that every run of eight is close together: halves by the wider axis of the disk, to whole groups.
fn gather(directions: &mut [Vec3], groups: usize) {
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
    gather(low, left);
    gather(high, groups - left);
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
            mean += all.iter().copied().sum::<Vec3>() / (192.0 * SETS as f32);
        }
        assert!(mean.truncate().length() < 0.01, "{mean}");
    }

    #[test]
    fn groups_point_roughly_the_same_way() {
        for (rays, least) in [(192, 0.85), (1000, 0.95)] {
            for set in &SampleSets::new(rays, 1).sets {
                let cosine = |group: &Lanes3| {
                    let axis = (0..LANES).map(|i| group.at(i)).sum::<Vec3>().normalize();
                    (0..LANES).map(|i| group.at(i).dot(axis)).fold(1.0, f32::min)
                };
                let mean = set.groups.iter().map(cosine).sum::<f32>() / set.groups.len() as f32;
                assert!(mean > least, "{rays} rays: {mean}");
            }
        }
    }

    #[test]
    fn a_point_always_gets_the_same_rays_and_points_differ() {
        let (a, b) = (SampleSets::new(16, 3), SampleSets::new(16, 3));
        assert_eq!(a.of(5).cos.to_bits(), b.of(5).cos.to_bits());
        assert_eq!(a.of(5).set.groups[0].x, b.of(5).set.groups[0].x);
        assert_ne!(a.of(5).cos.to_bits(), a.of(6).cos.to_bits());
        assert_ne!(a.of(5).cos.to_bits(), SampleSets::new(16, 4).of(5).cos.to_bits());
    }
}
