#version 460
// Lists the [pixel, node] pairs that the raster passes cover something with: for tests and for looking at cuts.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"
#include "common/microbuffer.glsl"

layout(local_size_x = 32) in;

layout(std430, binding = 10) writeonly buffer TracedPairs { uvec2 traced_pairs[]; };
layout(std430, binding = 11) buffer TracedCount { uint traced_count; };

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish() {}
#include "common/raster_loop.glsl"

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    if (footprint_of(site, centre, area_vector).density <= 0.0) return;
    uint at = atomicAdd(traced_count, 1u);
    if (at < traced_pairs.length()) {
        traced_pairs[at] = uvec2(entries[gather.first_entry + gl_GlobalInvocationID.x], node);
    }
}
