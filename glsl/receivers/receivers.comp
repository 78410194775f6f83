#version 460
// The cone mipmap of the G-buffer (Sabbadin 2019, 5.2.1): one workgroup turns a 16 x 16 tile into receivers of five
// levels. Every level holds a sphere of positions and a cone of normals that contain those of its pixels.
#extension GL_GOOGLE_include_directive : require
#include "shared/image_region.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform sampler2D position_map;
layout(binding = 1) uniform sampler2D normal_map;
layout(binding = 5, rgba32f) uniform writeonly imageBuffer receiver_spheres;
layout(binding = 6, rgba32f) uniform writeonly imageBuffer receiver_cones;
// One bit a covered pixel, eight words a tile, in Morton order.
layout(std430, binding = 7) writeonly buffer Coverage { uint coverage[]; };

shared vec4 positions[256]; // w: negative where nothing is covered
shared vec3 normals[256];
shared uint covered_bits[8];
shared uint covered_any;

// Even bits of a byte-sized Morton code, packed: 0b0y0x0y0x -> 0bxx.
uint even_bits(uint code) {
    code &= 0x55u;
    code = (code | (code >> 1u)) & 0x33u;
    return (code | (code >> 2u)) & 0x0fu;
}

// Writes the bound of the covered ones among `count` pixels from `first`: the smallest sphere around the centre of
// their bounding box and the smallest cone around the direction in the middle of their normals' box. Made from the
// pixels and not from the level below, which is tighter than a cone around cones and costs a tile 1,280 steps in all.
void bound(uint first, uint count, uint slot) {
    vec3 position_low = vec3(1e38), position_high = vec3(-1e38);
    vec3 normal_low = vec3(2.0), normal_high = vec3(-2.0);
    bool any = false;
    for (uint k = first; k < first + count; ++k) {
        if (positions[k].w < 0.0) continue;
        any = true;
        position_low = min(position_low, positions[k].xyz);
        position_high = max(position_high, positions[k].xyz);
        normal_low = min(normal_low, normals[k]);
        normal_high = max(normal_high, normals[k]);
    }
    if (!any) {
        imageStore(receiver_spheres, int(slot), vec4(0.0, 0.0, 0.0, -1.0));
        imageStore(receiver_cones, int(slot), vec4(0.0, 0.0, 0.0, 1.0));
        return;
    }
    vec3 centre = 0.5 * position_low + 0.5 * position_high;
    vec3 axis = normal_low + normal_high;
    float axis_length = length(axis);
    axis = axis_length > 1e-3 ? axis / axis_length : vec3(0.0, 1.0, 0.0);
    float radius = 0.0;
    float cosine = 1.0;
    for (uint k = first; k < first + count; ++k) {
        if (positions[k].w < 0.0) continue;
        radius = max(radius, distance(positions[k].xyz, centre));
        cosine = min(cosine, dot(normals[k], axis));
    }
    // Wider than rounding can make them too narrow.
    float size = abs(centre.x) + abs(centre.y) + abs(centre.z);
    imageStore(receiver_spheres, int(slot), vec4(centre, radius * (1.0 + 1e-6) + size * 2e-7));
    imageStore(receiver_cones, int(slot), vec4(axis, max(-1.0, cosine - 2e-6)));
}

void main() {
    uint tile = gl_WorkGroupID.x;
    uint code = gl_LocalInvocationID.x;
    if (code < 8u) covered_bits[code] = 0u;
    if (code == 0u) covered_any = 0u;
    barrier();
    uvec2 at = uvec2(tile % region.tiles_x, tile / region.tiles_x) * 16u + uvec2(even_bits(code), even_bits(code >> 1u));
    vec4 sphere = vec4(0.0, 0.0, 0.0, -1.0);
    vec4 cone = vec4(0.0, 0.0, 0.0, 1.0);
    if (at.x < region.width && at.y < region.height) {
        vec4 position = texelFetch(position_map, ivec2(at), 0);
        if (position.w > 0.0) {
            sphere = vec4(position.xyz, 0.0);
            cone = vec4(texelFetch(normal_map, ivec2(at), 0).xyz, 1.0);
            atomicOr(covered_bits[code >> 5u], 1u << (code & 31u));
            covered_any = 1u;
        }
    }
    positions[code] = sphere;
    normals[code] = cone.xyz;
    imageStore(receiver_spheres, int(tile * 256u + code), sphere);
    imageStore(receiver_cones, int(tile * 256u + code), cone);
    barrier();
    uint level_first = region.pixels;
    for (uint level = 1u; level <= 4u; ++level) {
        uint receivers = 256u >> (2u * level);
        if (code < receivers) {
            uint slot = level_first + tile * receivers + code;
            // One look is enough where there is nothing: software devices skip loops, not branches.
            bound(code << (2u * level), covered_any == 0u ? 1u : 1u << (2u * level), slot);
        }
        level_first += region.pixels >> (2u * level);
    }
    if (code < 8u) coverage[tile * 8u + code] = covered_bits[code];
}
