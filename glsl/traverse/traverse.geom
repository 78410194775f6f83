#version 460
// One step of the traversal for one pair (Sabbadin 2019, 5.2.1 and 5.2.2): stream 0 feeds the next iteration, stream 1
// collects the pairs that are done: the cut (mipmapped), or what a compute pass refines further (hybrid).
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"

layout(constant_id = 2) const bool HYBRID = false;

layout(points) in;
layout(points, max_vertices = 4) out;
layout(location = 0) in uvec2 pair[];
layout(location = 0, stream = 0, xfb_buffer = 0, xfb_offset = 0, xfb_stride = 8) out uvec2 next_pair;
layout(location = 1, stream = 1, xfb_buffer = 1, xfb_offset = 0, xfb_stride = 8) out uvec2 done_pair;

void emit_next(uint node, uint receiver) {
    next_pair = uvec2(node, receiver);
    EmitStreamVertex(0);
    EndStreamPrimitive(0);
}

void emit_done(uint node, uint receiver) {
    done_pair = uvec2(node, receiver);
    EmitStreamVertex(1);
    EndStreamPrimitive(1);
}

// Whether hybrid hands the pair over: Omega(A) <= Omega_tr at the receiver's nearest point, or a single pixel.
bool hands_over(uint node, uint level, vec4 ball) {
    vec4 sphere = node_sphere(node);
    float nearest = max(0.0, distance(sphere.xyz, ball.xyz) - ball.w);
    return level == 0u || sphere.w * sphere.w <= traversal.switch_sin2 * nearest * nearest;
}

void main() {
    uint node = pair[0].x;
    uint receiver = pair[0].y;
    uint slot = receiver_slot(traversal.pixels, receiver);
    Area area = node_area(node);
    uint level = receiver_level(receiver);
    vec4 ball = receiver_sphere(slot);
    uint action = decide(node, area, level, ball, receiver_cone(slot), traversal.stop_sin2);
    if (action == DISCARD) return;
    if (action == STOP || (HYBRID && hands_over(node, level, ball))) {
        emit_done(node, receiver);
    } else if (action == DESCEND) {
        emit_next(node + 1u, receiver);
        emit_next(node_skip(node + 1u), receiver);
    } else {
        uint child = first_child(receiver);
        for (uint k = 0u; k < 4u; ++k) {
            if (!receiver_is_empty(receiver_slot(traversal.pixels, child + k))) emit_next(node, child + k);
        }
    }
}
