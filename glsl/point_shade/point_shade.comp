#version 460
// What the screen shows of a cloud: colour and depth at every pixel; deferred shading with the normals of the pyramid
// (Bouchiba et al. 2018, 3.3).
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"
#include "common/rgb9e5.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer point_levels;
layout(binding = 1) uniform usamplerBuffer point_colors;
layout(binding = 2) uniform samplerBuffer filled;
layout(binding = 3) uniform usamplerBuffer filled_colors;
layout(binding = 4) uniform usamplerBuffer point_normals;
layout(binding = 5, rgba32f) uniform writeonly imageBuffer shaded; // colour, depth along the view in metres or 0
layout(binding = 6, rgba32f) uniform writeonly imageBuffer shaded_normals; // world space, w 1 where there is one

// As `PointDisplay`.
const uint RAW = 0u;
const uint FILLED = 1u;
const uint NORMALS = 2u;
const uint HEADLIGHT = 3u;
const uint EYE_DOME = 4u;

// Radius of the neighbourhood that normals come from, in spacings.
const float NORMAL_RADIUS = 4.0;
// Samples that differ in depth by more than this share lie on another surface.
const float SAME_SURFACE = 0.1;
// Eye-dome lighting (Boucheny 2009): how far its neighbours lie, pixels, and how dark its edges are.
const int DOME_RADIUS = 2;
const float DOME_STRENGTH = 40.0;

vec3 unpack_normal(uint bits) {
    vec2 place = unpackSnorm2x16(bits);
    vec3 normal = vec3(place, abs(place.x) + abs(place.y) - 1.0);
    if (normal.z > 0.0) {
        normal.xy = (1.0 - abs(place.yx)) * vec2(place.x < 0.0 ? -1.0 : 1.0, place.y < 0.0 ? -1.0 : 1.0);
    }
    return normalize(normal);
}

// Bilinear, from the samples of a level that lie on the surface at `depth`.
vec3 level_normal(vec2 pixel, uint level, int first, ivec2 size, float depth) {
    vec2 place = pixel / float(1u << level) - 0.5;
    vec2 corner = floor(place);
    vec2 part = place - corner;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; ++k) {
        ivec2 side = ivec2(k & 1, k >> 1);
        ivec2 at = clamp(ivec2(corner) + side, ivec2(0), size - 1);
        int slot = first + at.y * size.x + at.x;
        vec4 there = texelFetch(filled, slot);
        vec2 shares = mix(1.0 - part, part, vec2(side));
        bool same = there.w > 0.0 && abs(there.z - depth) <= SAME_SURFACE * depth;
        sum += unpack_normal(texelFetch(point_normals, slot).x) * (shares.x * shares.y * (same ? 1.0 : 1e-3));
    }
    return sum;
}

// Interpolated between the two levels whose samples are as far apart as the radius is at this depth.
vec3 smooth_normal(vec2 pixel, float depth) {
    float wanted = log2(max(1.0, NORMAL_RADIUS * point_view.spacing * point_view.focal / depth));
    float level = clamp(wanted, 0.0, float(point_view.levels) - 1.001);
    uint lower = uint(level);
    ivec2 size = ivec2(point_view.width, point_view.height);
    int first = 0;
    for (uint k = 0u; k < lower; ++k) {
        first += size.x * size.y;
        size = (size + 1) / 2;
    }
    vec3 fine = level_normal(pixel, lower, first, size, depth);
    if (lower + 1u == point_view.levels) return normalize(fine);
    vec3 coarse = level_normal(pixel, lower + 1u, first + size.x * size.y, (size + 1) / 2, depth);
    return normalize(mix(normalize(fine), normalize(coarse), level - float(lower)));
}

float dome_shade(ivec2 pixel, float depth) {
    const ivec2 RING[8] = ivec2[8](ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1), ivec2(-1, 0), ivec2(-1, -1),
                                   ivec2(0, -1), ivec2(1, -1));
    float response = 0.0;
    for (int k = 0; k < 8; ++k) {
        ivec2 at = pixel + DOME_RADIUS * RING[k];
        bool inside = all(greaterThanEqual(at, ivec2(0))) && at.x < int(point_view.width) && at.y < int(point_view.height);
        vec4 there = texelFetch(filled, inside ? at.y * int(point_view.width) + at.x : 0);
        if (inside && there.w > 0.0) response += max(0.0, log2(depth) - log2(there.z));
    }
    return exp(-DOME_STRENGTH * response / 8.0);
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    ivec2 at = ivec2(index % point_view.width, index / point_view.width);
    vec2 pixel = vec2(at) + 0.5;
    vec4 result = vec4(0.0);
    vec4 normal_world = vec4(0.0);
    if (point_view.display == RAW) {
        float depth = texelFetch(point_levels, int(index)).z;
        if (depth > 0.0) result = vec4(unpack_rgb9e5(texelFetch(point_colors, int(index)).x), depth);
    } else {
        vec4 surface = texelFetch(filled, int(index));
        if (surface.w > 0.0) {
            vec3 color = unpack_rgb9e5(texelFetch(filled_colors, int(index)).x);
            vec3 normal = smooth_normal(pixel, surface.z);
            vec3 ray = pixel_ray(pixel);
            // A filled sample is a mean of points around the pixel: the plane through it tells the depth at the pixel.
            float towards = dot(normal, ray);
            float planar = dot(normal, surface.xyz) / towards;
            if (abs(towards) > 0.05 * length(ray) && abs(planar - surface.z) < 0.05 * surface.z) surface.z = planar;
            normal_world = vec4(point_view.right * normal.x + point_view.down * normal.y + point_view.forward * normal.z, 1.0);
            if (point_view.display == NORMALS) color = 0.5 + 0.5 * normal_world.xyz;
            else if (point_view.display == HEADLIGHT) color = vec3(0.8 * max(0.0, -towards / length(ray)));
            else if (point_view.display == EYE_DOME) color *= dome_shade(at, surface.z);
            result = vec4(color, surface.z);
        }
    }
    imageStore(shaded, int(index), result);
    imageStore(shaded_normals, int(index), normal_world);
}
