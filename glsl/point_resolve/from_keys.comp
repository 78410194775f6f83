#version 460
#extension GL_GOOGLE_include_directive : require
#include "point_resolve/point_level.glsl"

layout(binding = 0) uniform usamplerBuffer point_keys; // colour, depth

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    uvec2 key = texelFetch(point_keys, int(index)).xy;
    store_point(index, uintBitsToFloat(key.y), key.x);
}
