#version 460
// From a level to the next coarser one.
#extension GL_GOOGLE_include_directive : require
#include "pull_push/combine.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.level_width * point_view.level_height) return;
    uvec2 finer = uvec2(point_view.width, point_view.height);
    for (uint level = 1u; level < point_view.level; ++level) finer = (finer + 1u) / 2u;
    uvec2 corner = 2u * uvec2(index % point_view.level_width, index / point_view.level_width);
    Sample samples[4];
    for (uint k = 0u; k < 4u; ++k) {
        uvec2 at = corner + uvec2(k & 1u, k >> 1u);
        bool inside = all(lessThan(at, finer));
        at = min(at, finer - 1u);
        samples[k] = load_sample(int(point_view.source + at.y * finer.x + at.x));
        if (!inside) samples[k].position.w = 0.0;
    }
    store_sample(int(point_view.target + index), combine(samples, vec4(1.0)));
}
