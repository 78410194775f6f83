#version 460
// Hybrid's second part (Sabbadin 2019, 5.2.2): each invocation takes one pair that the geometry shader left and walks
// its sub-tree depth first, splitting the receiver where its pixels disagree. The walk needs no stack of nodes: a
// sub-tree ends at its root's skip, and a receiver has at most four levels above the pixels.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 10) readonly buffer HandedPairs { uvec2 handed_pairs[]; };
layout(std430, binding = 11) writeonly buffer CutPairs { uvec2 cut_pairs[]; };

void append(uint node, uint receiver) {
    uint at = atomicAdd(cut_count, 1u);
    if (at < traversal.capacity) cut_pairs[at] = uvec2(node, receiver);
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= min(handed_count, traversal.capacity)) return;
    uvec2 pair = handed_pairs[index];
    uint node = pair.x;
    uint receiver = pair.y;
    uint root_level = receiver_level(receiver);
    // Where the sub-tree that is walked for a receiver of each level starts and ends.
    uint first[5];
    uint last[5];
    first[root_level] = node;
    last[root_level] = node_skip(node);
    uint visited = 0u;
    for (;;) {
        uint level = receiver_level(receiver);
        if (node == last[level]) {
            if (level == root_level) break;
            if ((receiver & 3u) == 3u) {
                // The fourth child is done: its parent goes on behind the sub-tree.
                receiver = receiver_code(level + 1u, receiver_index(receiver) >> 2u);
            } else {
                receiver += 1u;
                node = first[level];
            }
            continue;
        }
        uint slot = receiver_slot(traversal.pixels, receiver);
        vec4 ball = receiver_sphere(slot);
        if (ball.w < 0.0) { // no covered pixel below
            node = last[level];
            continue;
        }
        visited += 1u;
        Area area = node_area(node);
        uint action = 
            decide(node, area, level, ball, receiver_cone(slot), traversal.stop_sin2);
        if (action == SPLIT) {
            receiver = first_child(receiver);
            first[level - 1u] = node;
            last[level - 1u] = area.skip;
        } else if (action == DESCEND) {
            node += 1u;
        } else {
            if (action == STOP) append(node, receiver);
            node = area.skip;
        }
    }
    atomicAdd(visited_count, visited);
}
