#version 460
// Second half of rasterising the cut: every node of the front layer (at most 25 % farther than the nearest) adds its
// radiance to the micro-pixels under it, weighted by the share that it covers. Sums are fixed-point integers, so that
// order does not matter; a micro-pixel belongs to one invocation, so that they need no atomics.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_EXT_control_flow_attributes : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"
#include "common/microbuffer.glsl"
#include "common/sums.glsl"

layout(local_size_x = 32) in;

// Two halves a micro-pixel, the nearest depth in the high one; where nothing hides anything it is the largest float.
layout(binding = 10) uniform usamplerBuffer nearest_halves;
layout(std430, binding = 11) buffer Sums { uint64_t sums[]; };

const float FRONT_LAYER = 1.25;

void add(uint at, float share, vec3 color, float depth) {
    float front = uintBitsToFloat(texelFetch(nearest_halves, int(at)).y);
    precise float kept = depth > FRONT_LAYER * front ? 0.0 : share;
    precise vec3 part = color * kept;
    uvec4 fixed_part = uvec4(vec4(part, kept * COVERAGE_ONE) + 0.5);
    sums[2u * at] += (uint64_t(fixed_part.g) << 32) | uint64_t(fixed_part.r);
    sums[2u * at + 1u] += (uint64_t(fixed_part.a) << 32) | uint64_t(fixed_part.b);
}

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish() {}
#include "common/raster_loop.glsl"

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    Footprint footprint = footprint_of(site, centre, area_vector);
    if (footprint.density <= 0.0) return;
    vec3 color = node_color(node) * gather.color_scale;
    uvec2 first = uvec2(clamp(footprint.low, vec2(0.0), vec2(float(SIZE) - 1.0)));
    uvec2 last = uvec2(clamp(footprint.high, vec2(0.0), vec2(float(SIZE) - 1.0)));
    // Most boxes touch at most 2 x 2 micro-pixels: those take one turn.
    uvec2 blocks = (last - first) / 2u + 1u;
    uint turns = blocks.x * blocks.y;
    work += turns;
    for (uint turn = 0u; turn < turns; ++turn) {
        uvec2 corner = first + 2u * uvec2(turn % blocks.x, turn / blocks.x);
        [[unroll]] for (uint k = 0u; k < 4u; ++k) {
            uvec2 cell = corner + uvec2(k & 1u, k >> 1u);
            vec2 inside = min(footprint.high, vec2(cell) + 1.0) - max(footprint.low, vec2(cell));
            inside = cell.x < SIZE && cell.y < SIZE ? max(inside, vec2(0.0)) : vec2(0.0);
            uvec2 held = min(cell, uvec2(SIZE - 1u));
            add(start + held.y * SIZE + held.x, inside.x * inside.y * footprint.density, color, footprint.depth);
        }
    }
}
