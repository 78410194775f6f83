#version 460
// Counting sort of the cut's pairs by receiver, first step: the length of every receiver's list.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"
#include "common/receivers.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 8) buffer Lists { uvec2 lists[]; }; // offset, length
layout(binding = 11) uniform usamplerBuffer cut_pairs;

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= min(cut_count, traversal.capacity)) return;
    atomicAdd(lists[receiver_slot(traversal.pixels, texelFetch(cut_pairs, int(at)).y)].y, 1u);
}
