#version 460
// The cone mipmap of the G-buffer (Sabbadin 2019, 5.2.1): one workgroup turns a 16 x 16 tile into receivers of five
// levels. Every level holds a sphere of positions and a cone of normals that contain those of its pixels.
#extension GL_GOOGLE_include_directive : require
#include "shared/image_region.glsl"

layout(local_size_x = 64) in;

layout(binding = 0) uniform sampler2D position_map;
layout(binding = 1) uniform sampler2D normal_map;
layout(binding = 5, rgba32f) uniform writeonly imageBuffer receiver_spheres;
layout(binding = 6, rgba32f) uniform writeonly imageBuffer receiver_cones;
// One bit a covered pixel, eight words a tile, in Morton order.
layout(std430, binding = 7) writeonly buffer Coverage { uint coverage[]; };

// An invocation has the four pixels of a receiver of level 1. Bounds are made from the pixels and not from the level
// below, which is tighter than a cone around cones: the smallest sphere around the middle of the pixels' bounding box,
// and the smallest cone around the direction in the middle of their normals' box.
struct Box {
    vec3 position_low;
    vec3 position_high; // below `position_low` where nothing is covered
    vec3 normal_low;
    vec3 normal_high;
};

// Receivers of levels 1 to 4: 64, 16, 4, 1.
shared Box boxes[85];
// Of an invocation's pixels, for levels 2 to 4: largest distance from the middle, least cosine with the axis.
shared vec2 reaches[192];
shared uint covered_bits[8];

const uint FIRST[5] = uint[](0u, 0u, 64u, 80u, 84u);

// Even bits of a byte-sized Morton code, packed: 0b0y0x0y0x -> 0bxx.
uint even_bits(uint code) {
    code &= 0x55u;
    code = (code | (code >> 1u)) & 0x33u;
    return (code | (code >> 2u)) & 0x0fu;
}

Box empty_box() { return Box(vec3(1e38), vec3(-1e38), vec3(2.0), vec3(-2.0)); }

Box around(Box a, Box b) {
    return Box(min(a.position_low, b.position_low), max(a.position_high, b.position_high),
               min(a.normal_low, b.normal_low), max(a.normal_high, b.normal_high));
}

bool is_empty(Box box) { return box.position_low.x > box.position_high.x; }

vec3 middle_of(Box box) { return 0.5 * box.position_low + 0.5 * box.position_high; }

vec3 axis_of(Box box) {
    vec3 axis = box.normal_low + box.normal_high;
    float axis_length = length(axis);
    return axis_length > 1e-3 ? axis / axis_length : vec3(0.0, 1.0, 0.0);
}

void store(uint slot, Box box, vec2 reach) {
    bool empty = is_empty(box);
    vec3 middle = empty ? vec3(0.0) : middle_of(box);
    vec3 axis = empty ? vec3(0.0) : axis_of(box);
    // Wider than rounding can make them too narrow.
    float size = abs(middle.x) + abs(middle.y) + abs(middle.z);
    float radius = empty ? -1.0 : reach.x * (1.0 + 1e-6) + size * 2e-7;
    imageStore(receiver_spheres, int(slot), vec4(middle, radius));
    imageStore(receiver_cones, int(slot), vec4(axis, empty ? 1.0 : max(-1.0, reach.y - 2e-6)));
}

vec2 farther(vec2 a, vec2 b) { return vec2(max(a.x, b.x), min(a.y, b.y)); }

void main() {
    uint tile = gl_WorkGroupID.x;
    uint lane = gl_LocalInvocationID.x;
    if (lane < 8u) covered_bits[lane] = 0u;
    barrier();

    vec4 spheres[4];
    vec3 normals[4];
    Box box = empty_box();
    uint covered = 0u;
    uvec2 corner = uvec2(tile % region.tiles_x, tile / region.tiles_x) * 16u;
#define LOAD(k) { \
        uint code = 4u * lane + k; \
        uvec2 at = corner + uvec2(even_bits(code), even_bits(code >> 1u)); \
        bool inside = at.x < region.width && at.y < region.height; \
        vec4 position = texelFetch(position_map, ivec2(inside ? at : uvec2(0u)), 0); \
        bool lit = inside && position.w > 0.0; \
        spheres[k] = lit ? vec4(position.xyz, 0.0) : vec4(0.0, 0.0, 0.0, -1.0); \
        normals[k] = lit ? texelFetch(normal_map, ivec2(at), 0).xyz : vec3(0.0); \
        if (lit) { \
            box = around(box, Box(position.xyz, position.xyz, normals[k], normals[k])); \
            covered |= 1u << k; \
        } \
        imageStore(receiver_spheres, int(tile * 256u + code), spheres[k]); \
        imageStore(receiver_cones, int(tile * 256u + code), vec4(normals[k], 1.0)); }
    LOAD(0) LOAD(1) LOAD(2) LOAD(3)
    if (covered != 0u) atomicOr(covered_bits[lane >> 3u], covered << (4u * (lane & 7u)));

    boxes[lane] = box;
    barrier();
    for (uint level = 2u; level <= 4u; ++level) {
        if (lane < 256u >> (2u * level)) {
            uint child = FIRST[level - 1u] + 4u * lane;
            boxes[FIRST[level] + lane] = around(around(boxes[child], boxes[child + 1u]),
                                                around(boxes[child + 2u], boxes[child + 3u]));
        }
        barrier();
    }

    uint level_first = region.pixels;
    for (uint level = 1u; level <= 4u; ++level) {
        Box above = boxes[FIRST[level] + (lane >> (2u * (level - 1u)))];
        vec3 middle = middle_of(above);
        vec3 axis = axis_of(above);
        vec2 reach = vec2(0.0, 1.0);
#define REACH(k) if (spheres[k].w >= 0.0) { \
            reach = farther(reach, vec2(distance(spheres[k].xyz, middle), dot(normals[k], axis))); }
        REACH(0) REACH(1) REACH(2) REACH(3)
        if (level == 1u) store(level_first + tile * 64u + lane, above, reach);
        else reaches[64u * (level - 2u) + lane] = reach;
        level_first += region.pixels >> (2u * level);
    }
    barrier();

    level_first = region.pixels + (region.pixels >> 2u);
    for (uint level = 2u; level <= 4u; ++level) {
        uint receivers = 256u >> (2u * level);
        if (lane < receivers) {
            uint share = 64u / receivers;
            vec2 reach = vec2(0.0, 1.0);
            for (uint k = 0u; k < share; ++k) reach = farther(reach, reaches[64u * (level - 2u) + lane * share + k]);
            store(level_first + tile * receivers + lane, boxes[FIRST[level] + lane], reach);
        }
        level_first += region.pixels >> (2u * level);
    }
    if (lane < 8u) coverage[tile * 8u + lane] = covered_bits[lane];
}
