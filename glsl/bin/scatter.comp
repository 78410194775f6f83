#version 460
// Counting sort, last step: the nodes of every receiver, side by side.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"
#include "common/receivers.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 8) buffer Lists { uvec2 lists[]; }; // offset, length
layout(binding = 9, r32ui) uniform writeonly uimageBuffer cut_nodes;
layout(binding = 11) uniform usamplerBuffer cut_pairs;

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= min(cut_count, traversal.capacity)) return;
    uvec2 pair = texelFetch(cut_pairs, int(at)).xy;
    uint slot = receiver_slot(traversal.pixels, pair.y);
    imageStore(cut_nodes, int(lists[slot].x + atomicAdd(lists[slot].y, 1u)), uvec4(pair.x));
}
