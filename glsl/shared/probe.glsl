// Crosses the Rust border: passes::probe_light::ProbeConstants.
layout(push_constant) uniform Probe {
    uint width;        // of the level that is read, texels
    uint height;
    uint first;        // its first texel
    uint target_width; // of the level that is written
    uint target_height;
    uint target_first;
    uint rows;         // pairs of rows that an invocation adds up
    uint groups;       // partial sums
    float keep;        // alpha of Eq. 13
} probe;
