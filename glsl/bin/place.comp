#version 460
// Counting sort, second step: every receiver's list gets a place of its own. Which one does not matter, so one
// counter serves instead of a prefix sum. The length is zeroed again: the last step counts it up as it fills the list.
#extension GL_GOOGLE_include_directive : require
#include "common/counts.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 8) buffer Lists { uvec2 lists[]; }; // offset, length

void main() {
    uint slot = gl_GlobalInvocationID.x;
    if (slot >= lists.length()) return;
    uint length = lists[slot].y;
    if (length == 0u) return;
    lists[slot] = uvec2(atomicAdd(placed, length), 0u);
}
