// Crosses the Rust border: passes::Traversal.
layout(push_constant) uniform Traversal {
    uint pixels;       // pixel slots in the receiver buffers, a multiple of 256
    float stop_sin2;   // squared sine of the cone with the solid angle that stops the traversal (4 Omega)
    float switch_sin2; // the same for the solid angle at which hybrid leaves the geometry shader (32 Omega)
    uint capacity;     // pairs, or nodes a pixel, that fit where this pass appends
    uint list_capacity; // nodes that fit a tile's list (technique `shared`)
} traversal;
