//! Point-based ambient occlusion streams: suites across the crates.
