// Crosses the Rust border: passes::ImageRegion.
layout(push_constant) uniform ImageRegion {
    uint width;  // pixels
    uint height;
    uint tiles_x; // 16 x 16 tiles in a row
    uint pixels; // pixel slots in the receiver buffers
} region;
