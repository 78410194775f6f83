#version 460
// First half of rasterising the cut: the nearest node of every micro-pixel, by one 64-bit minimum on (depth, node), so
// that the result is the same whatever order nodes arrive in. (The paper's load, compare and store on an image loses
// one of two nodes that meet; `--paper image` keeps it.)
//
// A node hides what lies behind it in the micro-pixel of its centre and in those whose centres its box holds; a
// sliver hides nothing.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"
#include "common/microbuffer.glsl"

layout(local_size_x = 32) in;

layout(std430, binding = 10) buffer Nearest { uint64_t nearest[]; };
// The same words by halves: the depth is the high one.
layout(std430, binding = 10) readonly buffer NearestHalves { uint nearest_halves[]; };
void hide(uint at, uint depth, uint node) {
    // Reading first saves most of the atomics.
    if (depth <= nearest_halves[2u * at + 1u]) {
        atomicMin(nearest[at], (uint64_t(depth) << 32) | uint64_t(node));
    }
}

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish();
#include "common/raster_loop.glsl"

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    Footprint footprint = footprint_of(site, centre, area_vector);
    if (footprint.density <= 0.0) return;
    drawn += 1u;
    uint depth = floatBitsToUint(footprint.depth);
    vec2 middle = 0.5 * (footprint.low + footprint.high);
    uvec2 home = uvec2(clamp(middle, vec2(0.0), vec2(float(SIZE) - 1.0)));
    hide(start + home.y * SIZE + home.x, depth, node);
    // Boxes narrower than a micro-pixel hold no centre but that of their home.
    uvec2 first = uvec2(clamp(ceil(footprint.low - 0.5), vec2(0.0), vec2(float(SIZE))));
    uvec2 end = uvec2(clamp(floor(footprint.high + 0.5), vec2(0.0), vec2(float(SIZE))));
    uvec2 count = max(end, first) - first;
    uint cells = count.x * count.y;
    if (cells > 1u) {
        work += cells;
        for (uint cell = 0u; cell < cells; ++cell) {
            hide(start + (first.y + cell / count.x) * SIZE + first.x + cell % count.x, depth, node);
        }
    }
}

void finish() {
    atomicAdd(offered_count, uint64_t(offered));
    atomicAdd(drawn_count, uint64_t(drawn));
    atomicAdd(visited_count, uint64_t(visited));
}
