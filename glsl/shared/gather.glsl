// Crosses the Rust border: passes::Gather.
layout(push_constant) uniform Gather {
    uint pixels;        // pixel slots in the receiver buffers
    uint first_entry;   // this chunk's entries: first and count
    uint entry_count;
    float color_scale;  // radiance to fixed point: 2^32 / ((coverage_limit + 1) * brightest channel)
    vec3 eye;           // world space
    float coverage_limit; // sum of coverage that the fixed-point sums hold, in micro-pixels
    uint width;         // of the image region, pixels
    uint height;
    uint tiles_x;       // 16 x 16 tiles in a row of the image region
    float material_parameter; // diffuse: albedo; metal: GGX alpha
    uint far_field_height; // texels; 0 where there is no far field
    float stop_sin2;    // as in traversal.glsl, for classic's walk
    uint last_round;    // 1 in the last dispatch that a raster pass gets for this chunk
    float typical;      // mean luminance of the cloud
    float sharp_alpha;   // lobes with a smaller GGX alpha have buffers of their own; 0 for none
    float radiance_scale; // radiance to the texels of `shared` tiles
    uint store_columns; // micro-buffers in a row of the paper's image store
} gather;
