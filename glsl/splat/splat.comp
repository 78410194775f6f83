#version 460
// The paper's own ways of rasterising the cut, one node a micro-pixel, for comparison (Sabbadin 2019, 5.2.1 and 5.4):
// RAY_SPHERE asks at the centre of every micro-pixel whether the node's sphere is hit, at the depth of the plane
// through its centre (else the node's box counts where it holds the centre); IMAGE_STORE keeps colour and depth in
// half floats by image load, compare and store, of which one of two nodes that meet may get lost (else one 64-bit
// minimum on (depth, node)).
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/cut.glsl"
#include "common/microbuffer.glsl"

layout(constant_id = 5) const bool RAY_SPHERE = true;
layout(constant_id = 6) const bool IMAGE_STORE = true;

layout(local_size_x = 32) in;

layout(std430, binding = 10) buffer Nearest { uint64_t nearest[]; };
layout(binding = 12, rgba16f) uniform image2D store;
void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector);
void finish();
#include "common/raster_loop.glsl"

void put(uint start, uint x, uint y, float depth, uint node) {
    if (IMAGE_STORE) {
        uint buffer_index = start / MICRO_PIXELS;
        ivec2 at = ivec2(uvec2(buffer_index % gather.store_columns, buffer_index / gather.store_columns) * SIZE
                         + uvec2(x, y));
        // Depth in the fourth channel; zero where nothing has been stored.
        float stored = imageLoad(store, at).a;
        if (stored == 0.0 || depth < stored) imageStore(store, at, vec4(node_mean(node), depth));
    } else {
        uint at = start + y * SIZE + x;
        uint64_t key = (uint64_t(floatBitsToUint(depth)) << 32) | uint64_t(node);
        if (key < nearest[at]) atomicMin(nearest[at], key);
    }
}

void rasterise_sphere(uint start, Site site, uint node, vec3 centre) {
    precise vec3 to_node = centre - site.position;
    precise float distance2 = exact_dot(to_node, to_node);
    float radius = node_sphere(node).w;
    Cone cone = node_cone(node);
    if (pixel_discards(to_node, distance2, site.normal, radius, cone, 0.0)) return;
    drawn += 1u;
    float centre_distance = sqrt(distance2);
    bool inside = centre_distance <= radius;
    vec3 local = vec3(dot(site.tangent, to_node), dot(site.bitangent, to_node), dot(site.normal, to_node));
    vec3 local_axis = vec3(dot(site.tangent, cone.axis), dot(site.bitangent, cone.axis), dot(site.normal, cone.axis));
    float plane = dot(local, local_axis);
    // Bounds of the cone of directions that hit the sphere, projected onto the disc.
    vec2 low = vec2(-1.0), high = vec2(1.0);
    if (!inside) {
        float sine = radius / centre_distance;
        float cosine = sqrt(1.0 - sine * sine);
        vec2 at = local.xy / centre_distance;
        vec2 across = sqrt(max(vec2(0.0), 1.0 - at * at));
        low = mix(at * cosine - across * sine, vec2(-1.0), lessThan(at, vec2(-cosine)));
        high = mix(at * cosine + across * sine, vec2(1.0), greaterThan(at, vec2(cosine)));
    }
    ivec2 first = ivec2(clamp(floor((low * 0.5 + 0.5) * float(SIZE)), 0.0, float(SIZE) - 1.0));
    ivec2 last = ivec2(clamp(floor((high * 0.5 + 0.5) * float(SIZE)), 0.0, float(SIZE) - 1.0));
    work += uint((last.x - first.x + 2) * (last.y - first.y + 1));
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            vec2 disc = (vec2(x, y) + 0.5) * (2.0 / float(SIZE)) - 1.0;
            float rest = 1.0 - dot(disc, disc);
            if (rest <= 0.0) continue;
            vec3 direction = vec3(disc, sqrt(rest));
            float along = dot(direction, local);
            if (!inside && (along <= 0.0 || distance2 - along * along > radius * radius)) continue;
            float depth = plane / dot(direction, local_axis);
            bool sensible = depth > max(0.0, centre_distance - radius) && depth < centre_distance + radius;
            put(start, uint(x), uint(y), sensible ? depth : centre_distance, node);
        }
    }
}

void rasterise_box(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    Footprint footprint = footprint_of(site, centre, area_vector);
    if (footprint.density <= 0.0) return;
    drawn += 1u;
    ivec2 first = ivec2(clamp(ceil(footprint.low - 0.5), 0.0, float(SIZE)));
    ivec2 last = ivec2(clamp(floor(footprint.high - 0.5), -1.0, float(SIZE) - 1.0));
    work += uint(max(last.x - first.x + 2, 0) * max(last.y - first.y + 1, 0));
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) put(start, uint(x), uint(y), footprint.depth, node);
    }
}

void rasterise(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    if (RAY_SPHERE) {
        rasterise_sphere(start, site, node, centre);
    } else {
        rasterise_box(start, site, node, centre, area_vector);
    }
}

void finish() {
    atomicAdd(offered_count, uint64_t(offered));
    atomicAdd(drawn_count, uint64_t(drawn));
    atomicAdd(visited_count, uint64_t(visited));
}
