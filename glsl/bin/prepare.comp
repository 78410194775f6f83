#version 460
// Sizes the passes that follow from a counter, on the device: how many pairs there are, and the workgroups for them.
#extension GL_GOOGLE_include_directive : require
#include "shared/traversal.glsl"
#include "common/counts.glsl"

layout(constant_id = 2) const bool HYBRID = false;
// Reads the feedback counter (in bytes); otherwise the count that the refinement left.
layout(constant_id = 5) const bool FROM_FEEDBACK = true;

layout(local_size_x = 1) in;

layout(std430, binding = 10) readonly buffer FeedbackCounter { uint feedback_bytes; };
layout(std430, binding = 11) writeonly buffer Arguments { uint arguments[3]; };

void main() {
    uint count = FROM_FEEDBACK ? feedback_bytes / 8u : min(cut_count, traversal.capacity);
    if (FROM_FEEDBACK) {
        if (HYBRID) handed_count = count;
        else cut_count = count;
    }
    arguments[0] = (count + 63u) / 64u;
    arguments[1] = 1u;
    arguments[2] = 1u;
}
