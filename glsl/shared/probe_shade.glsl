// Crosses the Rust border: passes::probe_object::ShadeConstants. The instance has the name that common/surface.glsl knows.
layout(push_constant) uniform ShadeConstants {
    vec3 eye;           // world space
    uint width;         // of the image region, pixels
    uint height;
    float material_parameter; // diffuse: albedo; metal: GGX alpha
    float sharp_alpha;  // 0: no lobe has a buffer of its own
    float mirror;       // c_k of Eq. 15
} gather;
