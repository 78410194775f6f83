#version 460
// Hybrid's second part (Sabbadin 2019, 5.2.2): pairs that the geometry shader left are walked depth first, splitting the
// receiver where its pixels disagree. The walk needs no stack of nodes: a sub-tree ends at its root's skip, and a
// receiver has at most four levels above the pixels. Sub-trees differ much in size, so an invocation that is done with
// one takes the next that is left, and the invocations of a SIMD group stay busy together.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"

layout(local_size_x = 64) in;

layout(binding = 10) uniform usamplerBuffer handed_pairs;
layout(binding = 11, rg32ui) uniform writeonly uimageBuffer cut_pairs;

// Some devices end long loops silently (lavapipe after 65,535 turns of a SIMD group): an invocation takes no more pairs
// after this many turns, and one that a single pair keeps longer than the other gives the batch up.
const uint MOST_TURNS = 4000u;
const uint TOO_MANY_TURNS = 60000u;

// Technique `shared`: lists of tiles have places already.
layout(std430, binding = 8) buffer Lists { uvec2 lists[]; };
layout(binding = 9, r32ui) uniform writeonly uimageBuffer cut_nodes;

uint found = 0u;
uint longest = 0u;

void append(uint node, uint receiver) {
    if (SHARED) {
        uint slot = receiver_slot(traversal.pixels, receiver);
        uint at = atomicAdd(lists[slot].y, 1u);
        found += 1u;
        longest = max(longest, at + 1u);
        if (at < traversal.list_capacity) imageStore(cut_nodes, int(lists[slot].x + at), uvec4(node));
    } else {
        uint at = atomicAdd(cut_count, 1u);
        if (at < traversal.capacity) imageStore(cut_pairs, int(at), uvec4(node, receiver, 0u, 0u));
    }
}

// A number for each level below the one that a walk starts at, in registers.
uint at_level(uvec4 numbers, uint level) {
    return level < 2u ? (level == 0u ? numbers.x : numbers.y) : (level == 2u ? numbers.z : numbers.w);
}
uvec4 with_level(uvec4 numbers, uint level, uint number) {
    return mix(numbers, uvec4(number), equal(uvec4(level), uvec4(0u, 1u, 2u, 3u)));
}

void main() {
    uint most = min(handed_count, traversal.capacity);
    uint node = 0u;
    uint receiver = 0u;
    // Where the sub-tree that is walked ends for the receiver that the walk starts at, and where it starts and ends for
    // the receivers below.
    uint root_level = 0u;
    uint root_last = 0u;
    uvec4 first = uvec4(0u);
    uvec4 last = uvec4(0u);
    uint visited = 0u;
    uint turns = 0u;
    for (; turns < TOO_MANY_TURNS; ++turns) {
        uint level = receiver_level(receiver);
        uint end = level == root_level ? root_last : at_level(last, level);
        if (node == end) {
            if (level == root_level) {
                if (turns > MOST_TURNS) break;
                uint index = atomicAdd(taken, 1u);
                if (index >= most) break;
                uvec2 pair = texelFetch(handed_pairs, int(index)).xy;
                node = pair.x;
                receiver = pair.y;
                root_level = receiver_level(receiver);
                root_last = node_skip(node);
            } else if ((receiver & 3u) == 3u) {
                // The fourth child is done: its parent goes on behind the sub-tree.
                receiver = receiver_code(level + 1u, receiver_index(receiver) >> 2u);
            } else {
                receiver += 1u;
                node = at_level(first, level);
            }
            continue;
        }
        uint slot = receiver_slot(traversal.pixels, receiver);
        vec4 ball = receiver_sphere(slot);
        if (ball.w < 0.0) { // no covered pixel below
            node = end;
            continue;
        }
        visited += 1u;
        Area area = node_area(node);
        uint action = decide(node, area, level, ball, receiver_cone(slot), traversal.stop_sin2);
        if (action == SPLIT) {
            receiver = first_child(receiver);
            first = with_level(first, level - 1u, node);
            last = with_level(last, level - 1u, area.skip);
        } else if (action == DESCEND) {
            node += 1u;
        } else {
            if (action == STOP) append(node, receiver);
            node = area.skip;
        }
    }
    atomicAdd(visited_count, visited);
    if (SHARED) {
        atomicAdd(cut_count, found);
        atomicMax(placed, longest);
    }
    // As if there were more pairs than fit: the batch is split.
    if (turns == TOO_MANY_TURNS) {
        if (SHARED) atomicMax(placed, traversal.list_capacity + 1u);
        else atomicMax(cut_count, traversal.capacity + 1u);
    }
}
