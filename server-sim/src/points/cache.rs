//! A cache of point sets between runs: the key of an entry, and its bytes.

use std::fmt;

use glam::Vec3;
use thiserror::Error;

use super::{PointSet, PointSettings, SurfacePoint};
use crate::scene::{Mesh, RestMesh, Scene};

/// Version of the method. It grows whenever the method makes other points from the same scene and settings.
const METHOD_VERSION: u32 = 2;
/// First bytes of an entry.
const MAGIC: [u8; 8] = *b"psaopts\x01";
/// Size in bytes of the digest at the end of an entry.
const DIGEST_BYTES: usize = 32;
/// Sizes in bytes of a set without its points, and of one point.
const SET_BYTES: usize = 4 + 4 + 8;
const POINT_BYTES: usize = 4 + 4 + 4 + 1;

/// Storage of the points of scenes between runs. A cache affects only time: a damaged or foreign entry is rejected,
/// and the points are generated.
pub trait PointCache: Sync {
    /// Returns the bytes stored under a key, if there are any.
    fn load(&self, key: &PointKey) -> Option<Vec<u8>>;

    /// Stores bytes under a key. An implementation that cannot store them does nothing.
    fn store(&self, key: &PointKey, bytes: &[u8]);

    /// Reports that a loaded entry is unusable. New bytes are stored right afterwards.
    fn refused(&self, key: &PointKey, reason: &PointCacheError);
}

/// Key of the points of a scene: a BLAKE3 digest of everything that determines them. It covers the rest geometry,
/// mask and sides of every mesh, the settings and the version of the method. It is displayed in hexadecimal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PointKey([u8; 32]);

impl fmt::Display for PointKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(blake3::Hash::from(self.0).to_hex().as_str())
    }
}

impl PointKey {
    /// Returns the key of a scene's points.
    #[must_use]
    pub fn new(scene: &Scene, settings: &PointSettings) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"psao points");
        hasher.update(&METHOD_VERSION.to_le_bytes());
        hasher.update(&settings.per_m2.to_le_bytes());
        hasher.update(&settings.minimum.to_le_bytes());
        hasher.update(&settings.seed.to_le_bytes());
        for rest in scene.rests() {
            let mesh = &scene.meshes()[rest.mesh().index()];
            hash_geometry(&mut hasher, rest);
            hash_surface(&mut hasher, scene, mesh);
        }
        Self(hasher.finalize().into())
    }
}

/// Hashes a list, preceded by its length.
fn hash_list<T, const N: usize>(hasher: &mut blake3::Hasher, items: &[T], bytes: impl Fn(&T) -> [u8; N]) {
    hasher.update(&(items.len() as u64).to_le_bytes());
    let mut block = Vec::with_capacity(N * items.len().min(1 << 12));
    for items in items.chunks(1 << 12) {
        block.clear();
        block.extend(items.iter().flat_map(&bytes));
        hasher.update(&block);
    }
}

fn hash_geometry(hasher: &mut blake3::Hasher, rest: &RestMesh) {
    let bytes = |[a, b, c]: [[u8; 4]; 3]| std::array::from_fn::<u8, 12, _>(|i| [a, b, c][i / 4][i % 4]);
    hash_list(hasher, rest.geometry().positions(), |at: &Vec3| bytes(at.to_array().map(f32::to_le_bytes)));
    hash_list(hasher, rest.triangles(), |corners| bytes(corners.map(u32::to_le_bytes)));
    hasher.update(&rest.area_m2().to_le_bytes());
}

/// Hashes the number of sides and the mask.
fn hash_surface(hasher: &mut blake3::Hasher, scene: &Scene, mesh: &Mesh) {
    let material = scene.material(mesh);
    hasher.update(&[u8::from(material.double_sided())]);
    let (Some(mask), Some(uvs)) = (material.mask(), mesh.uvs()) else {
        hasher.update(&[0]);
        return;
    };
    hasher.update(&[1 + u8::from(mask.texture().is_some())]);
    hasher.update(&mask.factor().to_le_bytes());
    hasher.update(&mask.cutoff().to_le_bytes());
    if let Some(texture) = mask.texture() {
        let [u, v] = texture.wrap();
        hasher.update(&[u as u8, v as u8, u8::from(texture.nearest())]);
        texture.size().iter().for_each(|side| {
            hasher.update(&side.to_le_bytes());
        });
        hash_list(hasher, texture.texels(), |texel| *texel);
    }
    hash_list(hasher, uvs, |uv| {
        let [u, v] = uv.to_array().map(f32::to_le_bytes);
        std::array::from_fn::<u8, 8, _>(|i| [u, v][i / 4][i % 4])
    });
}

/// Reason why an entry is unusable.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PointCacheError {
    /// The bytes are not an entry, or one of another version.
    #[error("it holds no points of this version")]
    Foreign,
    /// The entry has the points of another key.
    #[error("it holds the points of another scene or of other settings")]
    Key,
    /// The digest at the end does not match the content.
    #[error("it is damaged: its digest does not match its content")]
    Digest,
    /// The digest matches, but the content is invalid.
    #[error("its points are not on the scene's meshes: set {set}")]
    Content {
        /// Number of the set.
        set: usize,
    },
}

/// Encodes an entry, little endian: magic, key, then the sets in the order of the meshes, then a BLAKE3 digest of all
/// that. A set has the number of its points (u32), their radius (f32) and area (f64). Each point has its triangle
/// (u32), weights (2 f32) and side (u8, 1: back).
pub(super) fn encode(key: &PointKey, sets: &[PointSet]) -> Vec<u8> {
    let points: usize = sets.iter().map(|set| set.points.len()).sum();
    let size = MAGIC.len() + key.0.len() + sets.len() * SET_BYTES + points * POINT_BYTES + DIGEST_BYTES;
    let mut bytes = Vec::with_capacity(size);
    bytes.extend(MAGIC);
    bytes.extend(key.0);
    for set in sets {
        bytes.extend((set.points.len() as u32).to_le_bytes());
        bytes.extend(set.radius.to_le_bytes());
        bytes.extend(set.area.to_le_bytes());
        for point in &set.points {
            bytes.extend(point.triangle.to_le_bytes());
            bytes.extend(point.bary[0].to_le_bytes());
            bytes.extend(point.bary[1].to_le_bytes());
            bytes.push(u8::from(point.back));
        }
    }
    let digest = blake3::hash(&bytes);
    bytes.extend(digest.as_bytes());
    bytes
}

/// Decodes the sets of an entry, one for each mesh of the scene.
///
/// # Errors
/// Returns [`PointCacheError`] for bytes that [`encode`] did not make for this key and scene. Memory is allocated
/// only for points whose bytes are present.
pub(super) fn decode(key: &PointKey, scene: &Scene, bytes: &[u8]) -> Result<Vec<PointSet>, PointCacheError> {
    let (content, digest) = bytes.split_last_chunk::<DIGEST_BYTES>().ok_or(PointCacheError::Foreign)?;
    let (magic, rest) = content.split_first_chunk().ok_or(PointCacheError::Foreign)?;
    let (found, mut rest) = rest.split_first_chunk().ok_or(PointCacheError::Foreign)?;
    if *magic != MAGIC {
        return Err(PointCacheError::Foreign);
    }
    if *found != key.0 {
        return Err(PointCacheError::Key);
    }
    if blake3::hash(content) != *digest {
        return Err(PointCacheError::Digest);
    }
    let mut sets = Vec::with_capacity(scene.rests().len());
    for (number, mesh) in scene.rests().iter().enumerate() {
        let (set, after) = decode_set(mesh, rest).ok_or(PointCacheError::Content { set: number })?;
        sets.push(set);
        rest = after;
    }
    if rest.is_empty() { Ok(sets) } else { Err(PointCacheError::Content { set: sets.len() }) }
}

/// Decodes one set. Returns it with the bytes after it.
fn decode_set<'a>(mesh: &RestMesh, bytes: &'a [u8]) -> Option<(PointSet, &'a [u8])> {
    let (count, bytes) = bytes.split_first_chunk()?;
    let (radius, bytes) = bytes.split_first_chunk()?;
    let (area, bytes) = bytes.split_first_chunk()?;
    let count = u32::from_le_bytes(*count) as usize;
    let (points, after) = bytes.split_at_checked(count.checked_mul(POINT_BYTES)?)?;
    let points: Option<Vec<SurfacePoint>> =
        points.chunks_exact(POINT_BYTES).map(|point| decode_point(mesh, point)).collect();
    let (radius, area) = (f32::from_le_bytes(*radius), f64::from_le_bytes(*area));
    let fine = radius.is_finite() && radius > 0.0 && area.is_finite();
    let set = PointSet { points: points?, numbers: (0..count as u32).collect(), radius, area, at_rest: None };
    fine.then_some((set, after))
}

fn decode_point(mesh: &RestMesh, bytes: &[u8]) -> Option<SurfacePoint> {
    let (triangle, bytes) = bytes.split_first_chunk()?;
    let (second, bytes) = bytes.split_first_chunk()?;
    let (third, bytes) = bytes.split_first_chunk()?;
    let triangle = u32::from_le_bytes(*triangle);
    let bary = [f32::from_le_bytes(*second), f32::from_le_bytes(*third)];
    let side = *bytes.first()?;
    let inside = (triangle as usize) < mesh.triangles().len()
        && bary.iter().all(|weight| (0.0..=1.0).contains(weight));
    (inside && side <= 1).then_some(SurfacePoint { triangle, bary, back: side == 1 })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Mutex;

    use super::*;
    use crate::points::{ScenePoints, generate, generate_cached};

    /// A cache in memory that records the calls.
    #[derive(Default)]
    struct MemoryCache {
        entries: Mutex<BTreeMap<String, Vec<u8>>>,
        events: Mutex<Vec<String>>,
    }

    impl PointCache for MemoryCache {
        fn load(&self, key: &PointKey) -> Option<Vec<u8>> {
            let found = self.entries.lock().unwrap().get(&key.to_string()).cloned();
            self.events.lock().unwrap().push(if found.is_some() { "found" } else { "none" }.to_owned());
            found
        }

        fn store(&self, key: &PointKey, bytes: &[u8]) {
            self.events.lock().unwrap().push("stored".to_owned());
            self.entries.lock().unwrap().insert(key.to_string(), bytes.to_vec());
        }

        fn refused(&self, _: &PointKey, reason: &PointCacheError) {
            self.events.lock().unwrap().push(reason.to_string());
        }
    }

    impl MemoryCache {
        fn events(&self) -> Vec<String> {
            std::mem::take(&mut self.events.lock().unwrap())
        }

        fn run(&self, scene: &Scene) -> ScenePoints {
            generate_cached(scene, &SETTINGS, Some(self), &|_, _| {}).unwrap()
        }
    }

    const SETTINGS: PointSettings = PointSettings { per_m2: 4.0, minimum: 40, seed: 2 };

    #[test]
    fn points_are_the_same_with_and_without() {
        let scene = Scene::load("robot-lab").unwrap();
        let cache = MemoryCache::default();
        let without = generate(&scene, &SETTINGS, &|_, _| {}).unwrap();
        for expected in [&["none", "stored"][..], &["found"]] {
            let with = cache.run(&scene);
            assert_eq!((with.sets(), with.offsets()), (without.sets(), without.offsets()));
            assert_eq!(cache.events(), expected);
        }
    }

    #[test]
    fn an_entry_that_is_not_whole_is_made_anew() {
        let scene = Scene::load("colonnade").unwrap();
        let cache = MemoryCache::default();
        let expected = cache.run(&scene);
        let key = PointKey::new(&scene, &SETTINGS);
        let good = cache.entries.lock().unwrap()[&key.to_string()].clone();
        let mut bad: Vec<Vec<u8>> = [0, 7, 8, 40, 41, 80, good.len() / 2, good.len() - 33, good.len() - 1]
            .into_iter()
            .flat_map(|at| {
                let mut flipped = good.clone();
                flipped[at] ^= 0x40;
                [flipped, good[..at].to_vec()]
            })
            .collect();
        bad.push([&good[..], &[0]].concat());
        for bytes in bad {
            cache.events();
            cache.entries.lock().unwrap().insert(key.to_string(), bytes);
            assert_eq!(cache.run(&scene).sets(), expected.sets());
            let events = cache.events();
            assert!(events.len() == 3 && events[2] == "stored", "{events:?}");
        }
    }

    #[test]
    fn content_that_does_not_fit_the_scene_is_refused() {
        let (scene, other) = (Scene::load("colonnade").unwrap(), Scene::load("robot-lab").unwrap());
        let key = PointKey::new(&scene, &SETTINGS);
        let sets = generate(&scene, &SETTINGS, &|_, _| {}).unwrap().sets;
        let check = |change: &dyn Fn(&mut Vec<PointSet>)| {
            let mut sets = sets.clone();
            change(&mut sets);
            decode(&key, &scene, &encode(&key, &sets))
        };
        assert_eq!(check(&|_| ()).unwrap(), sets);
        assert_eq!(
            check(&|sets| sets[1].points[3].triangle = u32::MAX),
            Err(PointCacheError::Content { set: 1 })
        );
        assert_eq!(
            check(&|sets| sets[0].points[0].bary[1] = f32::NAN),
            Err(PointCacheError::Content { set: 0 })
        );
        assert_eq!(check(&|sets| sets[0].radius = 0.0), Err(PointCacheError::Content { set: 0 }));
        let count = sets.len();
        assert_eq!(check(&|sets| sets.truncate(count - 1)), Err(PointCacheError::Content { set: count - 1 }));
        assert_eq!(
            check(&|sets| sets.push(PointSet::default())),
            Err(PointCacheError::Content { set: count })
        );
        assert_eq!(
            decode(&PointKey::new(&other, &SETTINGS), &other, &encode(&key, &sets)),
            Err(PointCacheError::Key)
        );
        assert_eq!(decode(&key, &scene, b"psao"), Err(PointCacheError::Foreign));
    }

    #[test]
    fn keys_differ_where_points_may() {
        let scene = Scene::load("colonnade").unwrap();
        let key = |settings| PointKey::new(&scene, &settings);
        let keys = [
            key(SETTINGS),
            key(PointSettings { per_m2: 4.5, ..SETTINGS }),
            key(PointSettings { minimum: 41, ..SETTINGS }),
            key(PointSettings { seed: 3, ..SETTINGS }),
            PointKey::new(&Scene::load("asteroids").unwrap(), &SETTINGS),
        ];
        for (index, key) in keys.iter().enumerate() {
            assert!(!keys[..index].contains(key), "{index}");
        }
        assert_eq!(PointKey::new(&Scene::load("colonnade").unwrap(), &SETTINGS), keys[0]);
    }

    #[test]
    fn a_version_stands_for_its_points() {
        // If this fails, the method makes other points: increase METHOD_VERSION, so that no cache returns points of
        // the old method.
        let scene = Scene::load("colonnade").unwrap();
        let sets = generate(&scene, &SETTINGS, &|_, _| {}).unwrap().sets;
        let bytes = encode(&PointKey([0; 32]), &sets);
        let digest = blake3::hash(&bytes).to_hex();
        assert_eq!((METHOD_VERSION, &digest[..16]), (2, "a1a7004fb1a57333"));
    }
}
