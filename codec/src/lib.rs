//! Point-based ambient occlusion streams: packing, cells, blocks, state hash, apply.
