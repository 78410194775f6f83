#version 460
// Which pixels of the front surface may lie across a silhouette: those beside a surface far behind or beside nothing.
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"

layout(local_size_x = 64) in;

layout(binding = 2) uniform samplerBuffer shaded_in; // colour, depth
layout(binding = 3, r32ui) uniform writeonly uimageBuffer surfel_sides_out; // those of all pixels, then the edges

#include "surfel_view/same_surface.glsl"
#include "surfel_view/surfel_sides.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint pixels = point_view.width * point_view.height;
    if (index >= pixels) return;
    ivec2 at = ivec2(index % point_view.width, index / point_view.width);
    ivec2 last = ivec2(point_view.width, point_view.height) - 1;
    float front = texelFetch(shaded_in, int(index)).w;
    float most = front + same_surface(front);
    bool edge = false;
    for (int k = 0; k < 9; ++k) {
        ivec2 beside = clamp(at + ivec2(k % 3, k / 3) - 1, ivec2(0), last);
        float depth = texelFetch(shaded_in, beside.y * int(point_view.width) + beside.x).w;
        if (depth == 0.0 || depth > most) edge = true;
    }
    edge = edge && front > 0.0;
    imageStore(surfel_sides_out, int(index), uvec4(edge ? 0u : ALL_SIDES));
    imageStore(surfel_sides_out, int(pixels + index), uvec4(edge ? 1u : 0u));
}
