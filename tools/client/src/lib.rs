//! Point-based ambient occlusion streams: from decoded state to pictures.
