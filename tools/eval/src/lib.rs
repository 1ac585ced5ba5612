//! Point-based ambient occlusion streams: references, error metrics, stress cases.
