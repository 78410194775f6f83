#version 460
#extension GL_GOOGLE_include_directive : require
#include "point_resolve/point_level.glsl"

layout(binding = 0) uniform sampler2D point_depth;
layout(binding = 1) uniform usampler2D point_color;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    ivec2 pixel = ivec2(index % point_view.width, index / point_view.width);
    store_point(index, texelFetch(point_depth, pixel, 0).x, texelFetch(point_color, pixel, 0).x);
}
