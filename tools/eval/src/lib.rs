//! Point-based ambient occlusion streams: references, error metrics, stress cases.
//!
//! The picture that a client reconstructs is compared with a picture traced by many rays a pixel
//! ([`reference`](mod@reference)), in figures ([`metric`]). Client and server share the geometry, so the client views
//! the server's world through [`adapter`]. Ambient occlusion reaches it through the stream alone.
//!
//! [`stress`] is a table of cases that strain the stream, each with its bound and the worst measured value. [`screen`]
//! holds the screen-space methods for comparison, each from its own paper, over one input. [`texture`] is the stream of
//! a texture atlas that the paper compares with. [`sweep`] measures settings and methods side by side, and [`report`]
//! writes the results.
//!
//! # Trace a reference and compare
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use psao_reconstruct::{AoImage, Size, cast_view};
//! use psao_eval::adapter::SceneView;
//! use psao_eval::metric::Comparison;
//! use psao_eval::reference::reference;
//! use psao_server::ao::AoSettings;
//! use psao_server::world::SceneBvh;
//! use psao_server::scene::Scene;
//!
//! // A wall stands on a floor; both face the camera.
//! let floor = [Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0];
//! let wall = [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0];
//! let scene = Arc::new(Scene::from_triangles("corner", &[vec![floor], vec![wall]], 0.6)?);
//! let world = SceneBvh::new(&scene, &scene.pose(0.0));
//! let scene_view = SceneView::new(&world);
//!
//! let view = cast_view(&scene_view, &scene.camera(0.0), Size::new(32, 18)?)?;
//! let truth = reference(&scene_view, &view, &AoSettings::default().with_rays(64))?;
//!
//! // No ambient occlusion at all is brighter than the truth, and never darker.
//! let open = AoImage::new(view.size(), vec![1.0; view.size().pixels()])?;
//! let found = Comparison::new(&truth, &open)?;
//! assert!(found.bias > 0.0 && (found.bias - found.mae).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod adapter;
#[cfg(test)]
mod end_to_end;
pub mod metric;
#[cfg(test)]
mod profiles;
pub mod reference;
pub mod report;
pub mod screen;
mod shapes;
pub mod stress;
pub mod sweep;
pub mod texture;
pub mod video;
