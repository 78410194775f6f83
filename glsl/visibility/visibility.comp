#version 460
// First half of rasterising the cut: the nearest node of every micro-pixel, by one 64-bit minimum on (depth, node), so
// that the result is the same whatever order nodes arrive in. (The paper's load, compare and store on an image loses
// one of two nodes that meet; `--paper image` keeps it.)
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_EXT_control_flow_attributes : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/microbuffer.glsl"

layout(local_size_x = 32) in;

layout(std430, binding = 10) buffer Nearest { uint64_t nearest[]; };
// Nodes handed to pixels, and those of them that cover something.
layout(std430, binding = 16) buffer RasterCounts { uint64_t offered_count; uint64_t drawn_count; };
uint offered = 0u;
uint drawn = 0u;

// A node hides what lies behind it in a micro-pixel when its centre lies there or it covers this share of it; a
// sliver hides nothing.
const float HIDING_SHARE = 0.25;

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector, float area2) {
    Footprint footprint = footprint_of(site, centre, area_vector, area2);
    offered += 1u;
    if (footprint.density <= 0.0) return;
    drawn += 1u;
    uint64_t key = (uint64_t(floatBitsToUint(footprint.depth)) << 32) | uint64_t(node);
    vec2 middle = 0.5 * (footprint.low + footprint.high);
    ivec2 home = ivec2(clamp(middle, vec2(0.0), vec2(float(SIZE) - 1.0)));
    ivec2 first = ivec2(max(footprint.low, vec2(0.0)));
    ivec2 last = ivec2(min(footprint.high, vec2(float(SIZE) - 1.0)));
    for (int y = first.y; y <= last.y; ++y) {
        float tall = min(footprint.high.y, float(y + 1)) - max(footprint.low.y, float(y));
        for (int x = first.x; x <= last.x; ++x) {
            float wide = min(footprint.high.x, float(x + 1)) - max(footprint.low.x, float(x));
            if (tall * wide * footprint.density < HIDING_SHARE && ivec2(x, y) != home) continue;
            uint at = start + uint(y) * SIZE + uint(x);
            // Reading first saves most of the atomics.
            if (key < nearest[at]) atomicMin(nearest[at], key);
        }
    }
}

void finish() {
    atomicAdd(offered_count, uint64_t(offered));
    atomicAdd(drawn_count, uint64_t(drawn));
}

#include "common/raster_loop.glsl"
