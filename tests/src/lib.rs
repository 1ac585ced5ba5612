//! Point-based ambient occlusion streams: suites across the crates. This library holds what the suites share.

use std::path::PathBuf;
use std::sync::Arc;

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::{Server, ServerError, ServerSettings, StepOutput};

/// The folder with real scenes and reference figures, which is no part of the repository: `$PSAO_SHARED`, or `shared`
/// beside the repository. Without it the caller skips, and a line says so; with `PSAO_REQUIRE_SHARED` set, that is a
/// failure.
///
/// # Panics
/// As said, when the folder is required and missing.
#[must_use]
pub fn shared(part: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    let folder = std::env::var_os("PSAO_SHARED").map_or(beside, PathBuf::from).join(part);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var_os("PSAO_REQUIRE_SHARED").is_none(), "there is no {}", folder.display());
    eprintln!("SKIPPED: there is no {}; set PSAO_SHARED to test with it", folder.display());
    None
}

/// Settings of a stream that is traced in a moment: few points, few rays, no compression to speak of.
#[must_use]
pub fn small(scene: &Scene, threshold: u8) -> ServerSettings {
    ServerSettings {
        points: PointSettings { per_m2: 2.0, minimum: 24, seed: 1 },
        ao: AoSettings { rays: 16, radius: scene.ao_radius_m(), ..AoSettings::default() },
        threshold,
        coder: psao_codec::block::BlockCoder::Zstd { level: 1 },
        ..ServerSettings::default()
    }
}

/// A server of a scene that reports to nobody.
///
/// # Errors
/// As [`Server::new`].
pub fn server(scene: &Arc<Scene>, settings: ServerSettings) -> Result<Server, ServerError> {
    Server::new(scene.clone(), settings, Arc::new(|_| ()))
}

/// Frame `number` of a server at 60 Hz, every point in view.
///
/// # Errors
/// As [`Server::step`].
pub fn step(server: &mut Server, number: u32) -> Result<StepOutput, ServerError> {
    let time = StreamTime(u64::from(number) * 1_000_000 / 60);
    server.step(FrameIndex(number), time, &[], &NoClock)
}
