#version 460
// Classic PBGI (Sabbadin 2019, 5.2, after Ritschel 2009): each invocation walks the whole hierarchy depth first for
// one pixel and keeps its cut as a list of its own.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"

layout(local_size_x = 64) in;

// Pixels of this batch as receiver indices.
layout(std430, binding = 7) readonly buffer Entries { uint entries[]; };
layout(std430, binding = 8) writeonly buffer Lists { uvec2 lists[]; };
layout(std430, binding = 9) writeonly buffer CutNodes { uint cut_nodes[]; };
layout(std430, binding = 12) buffer ClassicCounts {
    uint entry_count;
    uint longest;       // longest list wanted
    uint visited_count; // nodes visited by all pixels of the batch
    uint cut_count;     // nodes kept by all pixels of the batch
};

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= entry_count) return;
    uint pixel = entries[at];
    vec4 ball = receiver_sphere(pixel);
    vec4 normals = receiver_cone(pixel);
    uint begin = at * traversal.capacity;
    uint count = 0u;
    uint visited = 0u;
    uint end = node_skip(0u);
    for (uint node = 0u; node != end;) {
        visited += 1u;
        Area area = node_area(node);
        uint action = decide(node, area, 0u, ball, normals, traversal.stop_sin2);
        if (action == STOP) {
            if (count < traversal.capacity) cut_nodes[begin + count] = node;
            count += 1u;
        }
        node = action == DESCEND ? node + 1u : area.skip;
    }
    lists[pixel] = uvec2(begin, min(count, traversal.capacity));
    atomicMax(longest, count);
    atomicAdd(visited_count, visited);
    atomicAdd(cut_count, count);
}
