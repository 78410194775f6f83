#version 460
// Counting sort, last step: the nodes of every receiver, side by side.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"
#include "common/receivers.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 8) buffer Lists { uvec2 lists[]; }; // offset, length
layout(std430, binding = 9) writeonly buffer CutNodes { uint cut_nodes[]; };
layout(std430, binding = 11) readonly buffer CutPairs { uvec2 cut_pairs[]; };

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= min(cut_count, traversal.capacity)) return;
    uvec2 pair = cut_pairs[at];
    uint slot = receiver_slot(traversal.pixels, pair.y);
    cut_nodes[lists[slot].x + atomicAdd(lists[slot].y, 1u)] = pair.x;
}
