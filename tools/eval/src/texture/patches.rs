//! The patches of a scene, and the places of hits on them.

use psao_server::scene::{InstanceId, Scene};
use psao_server::world::Hit;

use super::pairs::{TrianglePair, pairs};

/// Number of a patch, which is one side of an instance's pair of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Patch(pub u32);

/// A place on a patch, in its unit square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchPoint {
    /// The patch.
    pub patch: Patch,
    /// Across, 0 to 1.
    pub u: f32,
    /// Down, 0 to 1.
    pub v: f32,
}

/// All patches of a scene.
///
/// The unit square of a patch has the first triangle's own corner at (0, 0) and the second's at (1, 1). The shared edge
/// is between (1, 0) and (0, 1). A single triangle is mirrored over that diagonal.
pub struct Patches {
    /// By rest mesh.
    pairs: Vec<Vec<TrianglePair>>,
    /// By rest mesh and triangle: its pair, and whether it is the pair's second triangle.
    of_triangle: Vec<Vec<(u32, bool)>>,
    /// First patch of each instance, then the number of patches.
    first: Vec<u32>,
    rests: Vec<u32>,
}

impl Patches {
    /// Pairs the triangles of every mesh at rest. Deformation keeps the pairs.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let pairs: Vec<Vec<TrianglePair>> =
            scene.rests().iter().map(|rest| pairs(rest.geometry(), rest.triangles())).collect();
        let of_triangle = scene.rests().iter().zip(&pairs).map(|(rest, pairs)| {
            let mut found = vec![(0, false); rest.triangles().len()];
            for (pair, number) in pairs.iter().zip(0..) {
                found[pair.first.triangle as usize] = (number, false);
                if let Some(second) = pair.second {
                    found[second.triangle as usize] = (number, true);
                }
            }
            found
        });
        let of_triangle = of_triangle.collect();
        let rests: Vec<u32> = scene.instances().iter().map(|instance| instance.rest().0).collect();
        let mut first = vec![0];
        for &rest in &rests {
            let before = first.last().copied().unwrap_or(0);
            first.push(before + 2 * pairs[rest as usize].len() as u32);
        }
        Self { pairs, of_triangle, first, rests }
    }

    /// Returns the number of patches; each side of a pair counts.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.first.last().copied().unwrap_or(0)
    }

    /// Returns whether the scene has no triangles.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the place of a hit in this scene, on the front or the back of its triangle.
    #[must_use]
    pub fn point(&self, hit: &Hit, back: bool) -> PatchPoint {
        let instance = hit.instance.index();
        let rest = self.rests[instance] as usize;
        let (pair, second) = self.of_triangle[rest][hit.triangle as usize];
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let TrianglePair { first, second: other } = self.pairs[rest][pair as usize];
        let half = if second { other.unwrap_or(first) } else { first };
        let after = |step: u8| weights[usize::from(half.apex + step) % 3];
        // The second triangle has the opposite orientation: (0, 1) and (1, 0) follow its own corner.
        let (u, v) = if second { (1.0 - after(1), 1.0 - after(2)) } else { (after(1), after(2)) };
        let patch = Patch(self.first[instance] + 2 * pair + u32::from(back));
        PatchPoint { patch, u: u.clamp(0.0, 1.0), v: v.clamp(0.0, 1.0) }
    }

    /// Returns the place on the triangles at a point of a patch, and whether it is on the back; `None` for a patch that
    /// the scene does not have. The place is a hit at distance 0.
    #[must_use]
    pub fn hit(&self, at: &PatchPoint) -> Option<(Hit, bool)> {
        let PatchPoint { patch: Patch(patch), u, v } = *at;
        let instance = self.first.partition_point(|&first| first <= patch).checked_sub(1)?;
        let rest = *self.rests.get(instance)?;
        let within = patch - self.first[instance];
        let TrianglePair { first, second } = *self.pairs[rest as usize].get(within as usize / 2)?;
        let beyond = u + v > 1.0;
        let (half, after) = match second {
            Some(second) if beyond => (second, [1.0 - u, 1.0 - v]),
            None if beyond => (first, [1.0 - v, 1.0 - u]),
            _ => (first, [u, v]),
        };
        let mut weights = [0.0; 3];
        weights[usize::from(half.apex)] = (1.0 - after[0] - after[1]).max(0.0);
        weights[usize::from(half.apex + 1) % 3] = after[0];
        weights[usize::from(half.apex + 2) % 3] = after[1];
        let hit = Hit {
            t: 0.0,
            instance: InstanceId(instance as u32),
            triangle: half.triangle,
            u: weights[1],
            v: weights[2],
        };
        Some((hit, within % 2 == 1))
    }
}
