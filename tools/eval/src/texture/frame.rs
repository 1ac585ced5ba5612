//! A server that shades an atlas frame by frame, and a client that looks up pixels in it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use psao_proto::message::CameraPose;
use psao_reconstruct::{AoImage, AoImageError, Camera, Size};
use psao_server::ao::{AoSettings, Scratch, Tracer};
use psao_server::clock::Clock;
use psao_server::points::RayKey;
use psao_server::scene::Scene;
use psao_server::world::SceneBvh;
use rayon::prelude::*;

use super::placement::{Changes, PlacementCost};
use super::visible::visible;
use super::{Atlas, Block, Extent, Patch, PatchLookup, PatchPoint, Patches, TextureError, TextureSettings};

/// Lines of the picture with which the server finds the patches in view.
const VISIBILITY_LINES: u32 = 540;
/// Factor by which the server's view is wider than the client's, so that blocks exist before patches come into view.
const VIEW_MARGIN: f64 = 1.1;
/// Seconds for which a patch out of view keeps its block.
const BLOCK_LIFETIME_S: f32 = 1.0;
/// Value of texels without a patch: open.
pub(crate) const EMPTY_TEXEL: u8 = 255;

/// The server of a texture-space stream. It shades the patches in view.
pub struct TextureServer {
    settings: TextureSettings,
    tracer: Tracer,
    patches: Arc<Patches>,
    world: SceneBvh,
    atlas: Atlas,
    /// Texels of the atlas, row by row.
    texels: Vec<u8>,
    /// Frames since a patch with a block was in view.
    ages: BTreeMap<Patch, u32>,
    placement: PlacementCost,
}

/// Counts, bytes and times of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextureStats {
    /// Patches in view.
    pub patches: u32,
    /// Their texels, which are all traced.
    pub texels: u64,
    /// Bytes that tell the client which patches have blocks, and of which extents, as an adaptive arithmetic coder would
    /// describe the changes. The client derives their places.
    pub placement_bytes: u64,
    /// Microseconds of posing and refitting, of finding the patches in view, and of tracing.
    pub micros: [u64; 3],
}

/// The places of the blocks in a frame, which a client knows beside the decoded atlas.
#[derive(Clone, Debug)]
pub struct BlockMap {
    atlas: Atlas,
}

impl TextureServer {
    /// Sets up the scene without blocks. The rays are those of `ao`, except for their number.
    ///
    /// # Errors
    ///
    /// [`TextureError`] when a setting is out of its range.
    pub fn new(
        scene: &Arc<Scene>,
        patches: &Arc<Patches>,
        settings: TextureSettings,
        ao: &AoSettings,
    ) -> Result<Self, TextureError> {
        settings.validate()?;
        let tracer = Tracer::new(ao.with_rays(settings.rays))?;
        Ok(Self {
            settings,
            tracer,
            patches: Arc::clone(patches),
            world: SceneBvh::new(scene, &scene.pose(0.0)),
            atlas: Atlas::default(),
            texels: Vec::new(),
            ages: BTreeMap::new(),
            placement: PlacementCost::new(),
        })
    }

    /// Returns the number of rows of the atlas so far.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.atlas.rows()
    }

    /// Returns the current atlas, row by row.
    #[must_use]
    pub fn texels(&self) -> &[u8] {
        &self.texels
    }

    /// Returns the current places of the blocks.
    #[must_use]
    pub fn block_map(&self) -> BlockMap {
        BlockMap { atlas: self.atlas.clone() }
    }

    /// Shades the patches that `camera` sees at `time_s`.
    ///
    /// # Errors
    ///
    /// [`TextureError`] when the camera is degenerate, or too much is in view for an atlas.
    pub fn step(
        &mut self,
        time_s: f64,
        camera: &CameraPose,
        clock: &dyn Clock,
    ) -> Result<TextureStats, TextureError> {
        let start = clock.micros();
        let scene = Arc::clone(self.world.scene());
        self.world.update(&scene.pose(time_s));
        let posed = clock.micros();
        let seen = self.sight(camera)?;
        let placement_bytes = self.place(&seen, &Camera::new(camera)?)?;
        let placed = clock.micros();
        let texels = self.shade(&seen);
        let traced = clock.micros();
        Ok(TextureStats {
            patches: seen.len() as u32,
            texels,
            placement_bytes,
            micros: [(start, posed), (posed, placed), (placed, traced)]
                .map(|(from, to)| to.saturating_sub(from)),
        })
    }

    /// Returns the patches in view and a little beside it, with their nearest distances in metres.
    fn sight(&self, camera: &CameraPose) -> Result<BTreeMap<Patch, f32>, TextureError> {
        let half = libm::tan(f64::from(camera.fov_y_deg).to_radians() * 0.5) * VIEW_MARGIN;
        let wide = CameraPose { fov_y_deg: (2.0 * libm::atan(half)).to_degrees() as f32, ..*camera };
        let sight = Camera::new(&wide)?;
        let width =
            (VISIBILITY_LINES as f32 * camera.aspect).clamp(1.0, 4.0 * VISIBILITY_LINES as f32) as u32;
        let size = Size::new(width, VISIBILITY_LINES)?;
        Ok(visible(&self.world, &self.patches, &sight, size))
    }

    /// Gives every patch in view a block of the right size, and first frees the blocks of patches that left the view long
    /// ago. Returns the bytes of these changes.
    fn place(&mut self, seen: &BTreeMap<Patch, f32>, camera: &Camera) -> Result<u64, TextureError> {
        let kept = (BLOCK_LIFETIME_S * self.settings.fps).max(1.0) as u32;
        let mut changes = Changes::new();
        self.ages.values_mut().for_each(|age| *age += 1);
        let gone: Vec<Patch> =
            self.ages.iter().filter(|&(_, &age)| age > kept).map(|(&patch, _)| patch).collect();
        for patch in gone.into_iter().filter(|patch| !seen.contains_key(patch)) {
            self.ages.remove(&patch);
            changes.insert(patch, [self.extent(patch), None]);
            self.atlas.release(patch);
        }
        let pixels_per_tangent = self.settings.lines as f32 / (2.0 * camera.tangents()[1] as f32);
        for (&patch, &nearest) in seen {
            self.ages.insert(patch, 0);
            let exact = self.exact(patch, pixels_per_tangent / nearest.max(f32::MIN_POSITIVE));
            let now = self.extent(patch);
            let extent = settle(exact, now, self.settings.most.ilog2() as u8);
            if now != Some(extent) {
                self.atlas.place(patch, extent)?;
                changes.insert(patch, [now, Some(extent)]);
            }
        }
        self.texels.resize(self.atlas.rows() as usize * Atlas::WIDTH as usize, EMPTY_TEXEL);
        Ok(self.placement.bytes(&changes))
    }

    /// Returns the extent of a patch's block, if it has one.
    fn extent(&self, patch: Patch) -> Option<Extent> {
        self.atlas.block(patch).map(|block| block.extent)
    }

    /// Returns the logarithms to base 2 of the texels that a patch should have, across and down.
    fn exact(&self, patch: Patch, pixels_per_metre: f32) -> [f32; 2] {
        let corner = |u, v| {
            let hit = self.patches.hit(&PatchPoint { patch, u, v });
            hit.and_then(|(hit, _)| self.world.surface(&hit)).map_or(Vec3::ZERO, |at| at.position)
        };
        let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)];
        let edges = [(b - a).length().max((d - c).length()), (c - a).length().max((d - b).length())];
        edges.map(|edge| libm::log2f(edge * pixels_per_metre / self.settings.divisor as f32))
    }

    /// Traces the texels of all patches in view. Returns their number.
    fn shade(&mut self, seen: &BTreeMap<Patch, f32>) -> u64 {
        let blocks: Vec<(Patch, Block)> =
            seen.keys().filter_map(|&patch| Some((patch, self.atlas.block(patch)?))).collect();
        let (tracer, patches, world) = (&self.tracer, &self.patches, &self.world);
        let shade = |scratch: &mut Scratch, &(patch, block): &(Patch, Block)| -> Vec<u8> {
            let mut texel = |index: u32| {
                let at = block.point(patch, index);
                let (hit, back) = patches.hit(&at)?;
                let surface = world.surface(&hit)?;
                let normal = if back { -surface.normal } else { surface.normal };
                // Each texel has its own rays, the same in every frame.
                let point = patch.0.wrapping_mul(0x9E37_79B1).wrapping_add(index);
                let ao = tracer.at(world, RayKey(point), surface.position, normal, scratch).ao;
                Some((ao * 255.0).round() as u8)
            };
            (0..block.extent.texels()).map(|index| texel(index).unwrap_or(EMPTY_TEXEL)).collect()
        };
        let shaded: Vec<Vec<u8>> = blocks.par_iter().map_init(Scratch::default, shade).collect();
        let mut count = 0;
        for ((_, block), values) in blocks.iter().zip(&shaded) {
            count += values.len() as u64;
            for (row, values) in (block.y..).zip(values.chunks_exact(block.extent.width() as usize)) {
                let start = (row * Atlas::WIDTH + block.x) as usize;
                self.texels[start..start + values.len()].copy_from_slice(values);
            }
        }
        count
    }
}

impl Block {
    /// Returns the place on the patch of texel number `index`, counted row by row.
    ///
    /// The outermost texels lie half a texel inside the patch, because its edges often lie inside other surfaces.
    /// Texels on the edges would join patches smoothly, but would show dark bars where a column meets its capital.
    fn point(&self, patch: Patch, index: u32) -> PatchPoint {
        let (width, height) = (self.extent.width(), self.extent.height());
        let along = |at: u32, of: u32| (at as f32 + 0.5) / of as f32;
        PatchPoint { patch, u: along(index % width, width), v: along(index / width, height) }
    }
}

impl BlockMap {
    /// Returns the AO of a picture's pixels, interpolated between the texels of a decoded atlas, and the share of the
    /// fragments without a block. Those fragments are open, as background is.
    ///
    /// # Errors
    ///
    /// In practice none, because bytes divided by 255 are in range.
    pub fn picture(&self, atlas: &[u8], look: &PatchLookup) -> Result<(AoImage, f64), AoImageError> {
        let values: Vec<Option<f32>> = look
            .points
            .par_iter()
            .map(|point| match point {
                Some(point) => self.sample(atlas, point),
                None => Some(1.0),
            })
            .collect();
        let missing = values.iter().filter(|value| value.is_none()).count();
        let fragments = look.points.iter().flatten().count();
        let values = values.into_iter().map(|value| value.unwrap_or(1.0)).collect();
        Ok((AoImage::new(look.size, values)?, missing as f64 / fragments.max(1) as f64))
    }

    fn sample(&self, atlas: &[u8], point: &PatchPoint) -> Option<f32> {
        let Block { x, y, extent } = self.atlas.block(point.patch)?;
        let along = |at: f32, texels: u32| {
            let at = (at * texels as f32 - 0.5).clamp(0.0, (texels - 1) as f32);
            let first = (at as u32).min(texels - 2);
            (first, at - first as f32)
        };
        let ((column, right), (row, down)) =
            (along(point.u, extent.width()), along(point.v, extent.height()));
        let texel = |column: u32, row: u32| {
            let index = (y + row) as usize * Atlas::WIDTH as usize + (x + column) as usize;
            atlas.get(index).map(|&value| f32::from(value) / 255.0)
        };
        let line = |row: u32| {
            let (left, next) = (texel(column, row)?, texel(column + 1, row)?);
            Some(left + (next - left) * right)
        };
        let (above, below) = (line(row)?, line(row + 1)?);
        Some((above + (below - above) * down).clamp(0.0, 1.0))
    }
}

/// Returns the extent of a block.
///
/// The block keeps its extent unless that is a quarter of a power of two too small, or one and a half powers too large.
/// Without this hysteresis, blocks would change their size all the time.
fn settle(exact: [f32; 2], now: Option<Extent>, most: u8) -> Extent {
    let side = |exact: f32, now: Option<u8>| match now {
        Some(now) if exact <= f32::from(now) + 0.25 && exact > f32::from(now) - 1.5 => now,
        _ => (exact.ceil().max(1.0) as u8).min(most),
    };
    Extent {
        across: side(exact[0], now.map(|extent| extent.across)),
        down: side(exact[1], now.map(|extent| extent.down)),
    }
}
