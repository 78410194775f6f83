#version 460
// First half of rasterising the cut: the depth of the nearest node of every micro-pixel, a minimum, which is the same
// whatever order nodes arrive in. A micro-pixel belongs to one invocation, so that it needs no atomics.
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

layout(local_size_x = 32, local_size_x_id = 11) in;

layout(binding = 10, r32f) uniform imageBuffer nearest_depths;

void hide(uint start, ivec2 cell, float depth) {
    int at = cell_at(start, cell);
    if (depth < imageLoad(nearest_depths, at).x) imageStore(nearest_depths, at, vec4(depth));
}

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish();
#include "common/raster_loop.glsl"

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    Footprint footprint = footprint_of(site, centre, area_vector);
    if (footprint.density <= 0.0) return;
    drawn += 1u;
    vec2 middle = 0.5 * (footprint.low + footprint.high);
    hide(start, kept(middle, float(SIZE) - 1.0), footprint.depth);
    // Boxes narrower than a micro-pixel hold no centre but that of their home.
    ivec2 first = kept(ceil(footprint.low - 0.5), float(SIZE));
    ivec2 end = kept(floor(footprint.high + 0.5), float(SIZE));
    ivec2 count = max(end, first) - first;
    if (count.x * count.y <= 1) return;
    work += uint(count.x * count.y);
    for (ivec2 cell = first; cell.y < end.y;) {
        hide(start, cell, footprint.depth);
        cell = cell.x + 1 == end.x ? ivec2(first.x, cell.y + 1) : ivec2(cell.x + 1, cell.y);
    }
}

void finish() {
    atomicAdd(offered_count, uint64_t(offered));
    atomicAdd(drawn_count, uint64_t(drawn));
    atomicAdd(visited_count, uint64_t(visited));
}
