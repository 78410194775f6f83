#version 460
// A level of the point pyramid: of four points the nearest (Bouchiba et al. 2018, 3.1.1).
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer point_levels;
layout(binding = 1, rgba32f) uniform writeonly imageBuffer point_levels_out;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.level_width * point_view.level_height) return;
    uvec2 finer = uvec2(point_view.width, point_view.height);
    for (uint level = 1u; level < point_view.level; ++level) finer = (finer + 1u) / 2u;
    uvec2 corner = 2u * uvec2(index % point_view.level_width, index / point_view.level_width);
    vec4 nearest = vec4(0.0);
    for (uint k = 0u; k < 4u; ++k) {
        // Beyond an odd edge the edge itself is looked at again.
        uvec2 at = min(corner + uvec2(k & 1u, k >> 1u), finer - 1u);
        vec4 point = texelFetch(point_levels, int(point_view.source + at.y * finer.x + at.x));
        if (point.z > 0.0 && (nearest.z == 0.0 || point.z < nearest.z)) nearest = point;
    }
    imageStore(point_levels_out, int(point_view.target + index), nearest);
}
