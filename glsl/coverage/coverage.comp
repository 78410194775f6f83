#version 460
// Second half of rasterising the cut: every node adds its radiance to the micro-pixels under it, weighted by the share
// that it covers: to the front layer where it is at most 25 % farther than the nearest, else to what shows where the
// front layer leaves a micro-pixel open. A micro-pixel belongs to one invocation, so that its sums need no atomics.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"
#include "common/microbuffer.glsl"
#include "common/sums.glsl"

layout(local_size_x = 32, local_size_x_id = 11) in;

layout(binding = 10) uniform samplerBuffer nearest_depths;
// Texels bring and take the four numbers of a layer at once.
layout(binding = 11, rgba32ui) uniform uimageBuffer layers;

const float FRONT_LAYER = 1.25;

// Technique `shared`: brightness times place in the texel, x and y, of the front layer; brightness times nearest depth
// over depth, of the front layer and of the back layer.
layout(binding = 13, rgba32ui) uniform uimageBuffer middles;

void add(int at, float share, vec3 color, float depth, vec2 middle) {
    float front = texelFetch(nearest_depths, at).x;
    bool back = depth > FRONT_LAYER * front;
    int layer = 2 * at + (back ? 1 : 0);
    // A single part is far below 2^31, and signed conversions are quicker.
    precise vec4 part = vec4(color, COVERAGE_ONE) * share;
    imageStore(layers, layer, imageLoad(layers, layer) + uvec4(ivec4(part + 0.5)));
    if (SHARED) {
        precise vec3 weighted = brightness(part.rgb) * vec3(middle, front / depth);
        ivec3 whole = ivec3(weighted + 0.5);
        imageStore(middles, at, imageLoad(middles, at) + uvec4(back ? ivec4(0, 0, 0, whole.z) : ivec4(whole, 0)));
    }
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
    ivec2 first = kept(footprint.low, float(SIZE) - 1.0);
    ivec2 last = kept(footprint.high, float(SIZE) - 1.0);
    work += uint((last.x - first.x + 1) * (last.y - first.y + 1));
    // One loop over both sides, because the invocations of a SIMD group then share its turns.
    for (ivec2 cell = first; cell.y <= last.y;) {
        vec2 low = max(footprint.low, vec2(cell));
        vec2 high = min(footprint.high, vec2(cell) + 1.0);
        vec2 inside = high - low;
        vec2 middle = 0.5 * (low + high) - vec2(cell);
        // Beyond an edge of the full sphere, the cell lies the other way round.
        if (SHARED && any(notEqual(clamp(cell, ivec2(0), ivec2(SIZE - 1u)), cell))) middle = 1.0 - middle;
        add(cell_at(start, cell), inside.x * inside.y * footprint.density, color, footprint.depth, middle);
        cell = cell.x == last.x ? ivec2(first.x, cell.y + 1) : ivec2(cell.x + 1, cell.y);
    }
}
