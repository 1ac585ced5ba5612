//! The server of point-based ambient occlusion streams: scenes, rays, points and the frame loop.
//!
//! Data flows one way: a [`scene`] is posed, [`world::SceneBvh`] makes it ready for rays, [`points`] lie on its surfaces,
//! [`ao`] traces them, and [`server::Server`] writes what changed as frame bodies. Time comes in as an argument,
//! randomness from a seed; the same arguments give the same bytes on any machine. Only `server::live` (feature `live`), the loop
//! of a live server, reads a clock.
//!
//! # Stream two frames of a built-in scene
//!
//! ```
//! use std::sync::Arc;
//! use psao_codec::envelope::{FrameIndex, FrameKind, StreamTime};
//! use psao_server::clock::NoClock;
//! use psao_server::points::PointSettings;
//! use psao_server::scene::Scene;
//! use psao_server::server::{Server, ServerSettings};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Arc::new(Scene::load("colonnade")?);
//! let points = PointSettings::default().with_per_m2(1.0).with_minimum(16);
//! let settings = ServerSettings::default().with_points(points);
//! let mut server = Server::new(scene, settings, Arc::new(|_progress| {}))?;
//!
//! // Without a view every point counts as seen. The first frame holds every point of the scene.
//! let first = server.step(FrameIndex(0), StreamTime(0), &[], &NoClock)?;
//! assert_eq!(first.info.kind, FrameKind::Key);
//! assert_eq!(first.stats.changed, server.points().total());
//!
//! let second = server.step(FrameIndex(1), StreamTime(16_667), &[], &NoClock)?;
//! assert!(second.stats.rays < first.stats.rays);
//! # Ok(())
//! # }
//! ```
//!
//! # Trace one place of a scene
//!
//! ```
//! use std::sync::Arc;
//! use glam::Vec3;
//! use psao_server::ao::{AoSettings, Scratch, Tracer};
//! use psao_server::world::SceneBvh;
//! use psao_server::points::RayKey;
//! use psao_server::scene::Scene;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Arc::new(Scene::load("colonnade")?);
//! let world = SceneBvh::new(&scene, &scene.pose(0.0));
//! let top = world.bounds().max().y + 1.0;
//! let hit = world.closest(Vec3::new(0.0, top, 0.0), Vec3::NEG_Y, 100.0).ok_or("nothing below")?;
//! let surface = world.surface(&hit).ok_or("not of this world")?;
//!
//! let tracer = Tracer::new(AoSettings::default().with_rays(512))?;
//! let ao = tracer.at(&world, RayKey(0), surface.position, surface.normal, &mut Scratch::default()).ao;
//! assert!(ao > 0.0 && ao <= 1.0);
//! # Ok(())
//! # }
//! ```

pub mod ao;
pub mod bvh;
pub mod clip;
pub mod clock;
pub mod points;
mod random;
pub mod scene;
pub mod server;
mod shortcuts;
pub mod visibility;
pub mod world;

pub use shortcuts::Shortcuts;
