#version 460
// A level of the importance pyramid: sums of four (Clarberg et al. 2005).
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"

layout(local_size_x = 64) in;

layout(binding = 0) uniform samplerBuffer importance;
layout(binding = 1, r32f) uniform writeonly imageBuffer importance_out;

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint size = (lamp_pass.side * lamp_pass.light_size) >> lamp_pass.level;
    if (index >= size * size) return;
    ivec2 corner = 2 * ivec2(index & (size - 1u), index >> uint(findMSB(size)));
    int at = importance_level(lamp_pass.level - 1u) + corner.y * int(2u * size) + corner.x;
    float sum = texelFetch(importance, at).x + texelFetch(importance, at + 1).x
              + texelFetch(importance, at + int(2u * size)).x + texelFetch(importance, at + int(2u * size) + 1).x;
    imageStore(importance_out, importance_level(lamp_pass.level) + int(index), vec4(sum));
}
