//! Point-based ambient occlusion streams: suites across the crates. This library holds their shared helpers.

use std::path::PathBuf;
use std::sync::Arc;

use psao_codec::envelope::{FrameIndex, StreamTime};
use psao_server::ao::AoSettings;
use psao_server::clock::NoClock;
use psao_server::points::PointSettings;
use psao_server::scene::Scene;
use psao_server::server::{Server, ServerError, ServerSettings, StepOutput};

/// Returns `part` of the folder with real scenes and reference figures, or `None` without that folder.
///
/// The folder is `$PSAO_SHARED`, or `shared` beside the repository. It is not part of the repository. A missing folder
/// prints a line, so that a skipped test is visible.
///
/// # Panics
/// When the folder is missing and `PSAO_REQUIRE_SHARED` is set.
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

/// Returns settings for a quick test: few points, few rays, fast compression.
#[must_use]
pub fn fast_settings(scene: &Scene, threshold: u8) -> ServerSettings {
    ServerSettings::default()
        .with_points(PointSettings::default().with_per_m2(2.0).with_minimum(24).with_seed(1))
        .with_ao(AoSettings::default().with_rays(16).with_radius(scene.ao_radius_m()))
        .with_threshold(threshold)
        .with_coder(psao_codec::block::BlockCoder::Zstd { level: 1 })
}

/// Creates a server of a scene without progress reports.
///
/// # Errors
/// As [`Server::new`].
pub fn server(scene: &Arc<Scene>, settings: ServerSettings) -> Result<Server, ServerError> {
    Server::new(scene.clone(), settings, Arc::new(|_| ()))
}

/// Makes frame `number` of a server at 60 Hz with every point in view.
///
/// # Errors
/// As [`Server::step`].
pub fn step(server: &mut Server, number: u32) -> Result<StepOutput, ServerError> {
    let time = StreamTime(u64::from(number) * 1_000_000 / 60);
    server.step(FrameIndex(number), time, &[], &NoClock)
}
