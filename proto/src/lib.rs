//! Point-based ambient occlusion streams: frames, sessions, recordings.
