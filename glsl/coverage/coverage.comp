#version 460
// Second half of rasterising the cut: every node of the front layer (at most 25 % farther than the nearest) adds its
// radiance to the micro-pixels under it, weighted by the share that it covers. Sums are fixed-point integers, so that
// order does not matter; a micro-pixel belongs to one invocation, so that they need no atomics.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/microbuffer.glsl"
#include "common/sums.glsl"

layout(local_size_x = 32) in;

layout(std430, binding = 10) readonly buffer Nearest { uint64_t nearest[]; };
layout(std430, binding = 11) buffer Sums { uint64_t sums[]; };

const float FRONT_LAYER = 1.25;

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector, float area2) {
    Footprint footprint = footprint_of(site, centre, area_vector, area2);
    if (footprint.density <= 0.0) return;
    vec3 color = node_color(node) * gather.color_scale;
    ivec2 first = ivec2(max(footprint.low, vec2(0.0)));
    ivec2 last = ivec2(min(footprint.high, vec2(float(SIZE) - 1.0)));
    for (int y = first.y; y <= last.y; ++y) {
        float tall = min(footprint.high.y, float(y + 1)) - max(footprint.low.y, float(y));
        for (int x = first.x; x <= last.x; ++x) {
            float wide = min(footprint.high.x, float(x + 1)) - max(footprint.low.x, float(x));
            uint at = start + uint(y) * SIZE + uint(x);
            // The nearest distance; where nothing hides anything it is the largest float, which keeps all.
            float front = uintBitsToFloat(uint(nearest[at] >> 32));
            if (footprint.depth > FRONT_LAYER * front) continue;
            precise float share = tall * wide * footprint.density;
            precise vec3 part = color * share;
            uvec3 fixed_part = uvec3(part + 0.5);
            sums[2u * at] += (uint64_t(fixed_part.r) << 32) | uint64_t(fixed_part.g);
            sums[2u * at + 1u] += (uint64_t(fixed_part.b) << 32) | uint64_t(uint(share * COVERAGE_ONE + 0.5));
        }
    }
}

void finish() {}

#include "common/raster_loop.glsl"
