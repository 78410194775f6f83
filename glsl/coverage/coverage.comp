#version 460
// Second half of rasterising the cut: every node adds its radiance to the micro-pixels under it, weighted by the share
// that it covers: to the front layer where it is at most 25 % farther than the nearest, else to what shows where the
// front layer leaves a micro-pixel open. Sums are fixed-point integers, so that
// order does not matter; a micro-pixel belongs to one invocation, so that they need no atomics.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
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
    uint layer = depth > FRONT_LAYER * front ? 1u : 0u;
    precise vec4 part = vec4(color, COVERAGE_ONE) * share;
    uvec4 fixed_part = uvec4(part + 0.5);
    uint word = 4u * at + 2u * layer;
    sums[word] += (uint64_t(fixed_part.g) << 32) | uint64_t(fixed_part.r);
    sums[word + 1u] += (uint64_t(fixed_part.a) << 32) | uint64_t(fixed_part.b);
}

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish() {}
#include "common/raster_loop.glsl"

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    Footprint footprint = footprint_of(site, centre, area_vector);
    if (footprint.density <= 0.0) return;
    // The largest channel of any point's radiance, from which the scale to fixed point was made.
    float brightest = 4294967296.0 / ((gather.coverage_limit + 1.0) * gather.color_scale);
    precise vec3 radiance = node_radiance(node, centre - site.position, area_vector, brightest);
    precise vec3 color = radiance * gather.color_scale;
    uvec2 first = uvec2(clamp(footprint.low, vec2(0.0), vec2(float(SIZE) - 1.0)));
    uvec2 last = uvec2(clamp(footprint.high, vec2(0.0), vec2(float(SIZE) - 1.0)));
    uvec2 count = last - first + 1u;
    uint cells = count.x * count.y;
    work += cells;
    for (uint k = 0u; k < cells; ++k) {
        uvec2 cell = first + uvec2(k % count.x, k / count.x);
        vec2 inside = min(footprint.high, vec2(cell) + 1.0) - max(footprint.low, vec2(cell));
        add(start + cell.y * SIZE + cell.x, inside.x * inside.y * footprint.density, color, footprint.depth);
    }
}
