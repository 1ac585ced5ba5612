//! Point-based ambient occlusion streams: scenes, rays and the simulated server.
