// Push constants of the lamp passes (`LampPass` in passes/lamp_view.rs): the camera as in point_view.glsl, sizes, and what
// one dispatch is about.
layout(push_constant) uniform LampPass {
    vec3 eye;
    float focal; // distance to the image plane, pixels
    vec3 right;
    uint width; // of the camera's image
    vec3 down;
    uint height;
    vec3 forward;
    uint vpls;
    uint views;      // of all lamps
    uint view;       // that the pass writes
    uint light_size; // pixels along a side of a lamp's view, a power of two
    uint side;       // views along a side of their atlas, a power of two
    uint ism_size;   // texels along a side of a shadow map, a power of two
    uint level;      // that the pass writes
    uint interleave; // 1, 2 or 4
    uint bounce;     // from 0 on
    uint first;      // point of the dispatch in its buffer
    uint count;      // points of the dispatch, or of the buffer
    uint base;       // number in the cloud of the buffer's first point
    uint points;     // of the cloud
    uint offset;     // from a point's place along the cloud to the light that it serves
    float spread;    // from the spacing of a point to that of the points of one map
    float material;  // albedo or GGX alpha of an object
} lamp_pass;
