#version 460
// Technique `shared`: from the fixed-point sums of a tile's texels to their radiance, and how much the tile's extent
// matters. One workgroup a tile.
#extension GL_GOOGLE_include_directive : require
#include "shared/gather.glsl"
#include "common/receivers.glsl"
#include "common/far_field.glsl"
#include "common/octahedral.glsl"
#include "common/tile_texel.glsl"
#include "common/sums.glsl"

layout(constant_id = 3) const uint SIZE = 34u;

layout(local_size_x = 64) in;

layout(std430, binding = 7) readonly buffer Entries { uint entries[]; }; // receiver codes of tiles
layout(binding = 10) uniform samplerBuffer nearest_depths;
layout(binding = 11) uniform usamplerBuffer layers;
layout(binding = 12) uniform usamplerBuffer middles;
layout(binding = 13, rgba32ui) uniform writeonly uimageBuffer tile_texels; // two texels each (common/tile_texel.glsl)
layout(std430, binding = 14) readonly buffer TileSlots { uint tile_slots[]; }; // by entry: where its texels go
layout(std430, binding = 15) writeonly buffer TileParallax { float tile_parallax[]; }; // by entry
layout(std430, binding = 16) buffer ConvolveCounts { uint overflowed; };

const uint PAIRS = SIZE * SIZE / 2u;

// A front layer that covers this share of a texel hides what lies behind; a smaller one lets the rest show.
const float OPAQUE = 0.75;
// Radiance in multiples of the cloud's mean from which a texel counts as a lamp's.
const float LAMP = 8.0;

shared vec2 sums[64];

float solid_angle() { return 12.566370614 / float(SIZE * SIZE); } // of a texel

// Where footprints overlap unevenly, the covered sum is not the texel's solid angle: ordinary light is divided by it,
// but dividing would move the energy of a lamp that straddles texels, whose sums are right in all.
vec3 kept_light(vec3 mean_radiance, float share) {
    float brightness = luminance(mean_radiance) / (LAMP * gather.typical);
    float lamp = brightness * brightness / (1.0 + brightness * brightness);
    return mean_radiance * mix(1.0, share, lamp) + vec3(gather.typical * lamp * (1.0 - share));
}

// Radiance of a texel, where in it its light comes from, and the nearest depth over that of the light.
vec3 texel_radiance(int at, vec2 corner, out vec2 middle, out float nearness) {
    middle = vec2(0.5);
    nearness = 1.0;
    uvec4 front = texelFetch(layers, 2 * at);
    uvec4 back = texelFetch(layers, 2 * at + 1);
    vec2 coverage = vec2(front.a, back.a) / COVERAGE_ONE;
    if (coverage.x + coverage.y == 0.0) {
        return far_radiance(octahedral_direction((corner + 0.5) / float(SIZE)), solid_angle());
    }
    if (max(coverage.x, coverage.y) > gather.coverage_limit) overflowed = 1u;
    vec3 front_mean = vec3(front.rgb) / max(1e-9, gather.color_scale * coverage.x);
    vec3 back_mean = vec3(back.rgb) / max(1e-9, gather.color_scale * coverage.y);
    uvec4 weighted = texelFetch(middles, at);
    vec2 bright = vec2(brightness(vec3(front.rgb)), brightness(vec3(back.rgb)));
    if (bright.x > 0.0) middle = clamp(vec2(weighted.xy) / bright.x, vec2(0.0), vec2(1.0));
    if (bright.x > 0.0) nearness = min(1.0, float(weighted.z) / bright.x);
    else if (bright.y > 0.0) nearness = min(1.0, float(weighted.w) / bright.y);
    float opaque = coverage.y > 0.0 ? min(1.0, coverage.x / OPAQUE) : 1.0;
    return (opaque == 1.0 ? kept_light(front_mean, coverage.x) : opaque * front_mean) + back_mean * (1.0 - opaque);
}

void main() {
    uint entry = gl_WorkGroupID.x;
    uint lane = gl_LocalInvocationID.x;
    uint first = tile_slots[gather.first_entry + entry] * PAIRS;
    float radius = receiver_sphere(receiver_slot(gather.pixels, entries[gather.first_entry + entry])).w;
    // A texel's side as an angle, in which parallax is measured.
    float reach = radius / sqrt(solid_angle());
    vec2 sum = vec2(0.0); // luminance, and its parallax
    for (uint k = lane; k < PAIRS; k += 64u) {
        uvec4 texels = uvec4(0u);
        for (uint second = 0u; second < 2u; ++second) {
            uint texel = 2u * k + second;
            int at = int(entry * 2u * PAIRS + texel);
            vec2 corner = vec2(texel % SIZE, texel / SIZE);
            vec2 middle;
            float nearness;
            vec3 radiance = texel_radiance(at, corner, middle, nearness);
            float weight = luminance(radiance) + 0.1 * gather.typical;
            float depth = texelFetch(nearest_depths, at).x;
            float parallax = min(4.0, reach / depth);
            sum += weight * vec2(1.0, parallax);
            uvec2 packed_texel = pack_texel(radiance * gather.radiance_scale, middle, depth < 1e30 ? nearness / depth : 0.0);
            if (second == 0u) texels.xy = packed_texel;
            else texels.zw = packed_texel;
        }
        imageStore(tile_texels, int(first + k), texels);
    }
    sums[lane] = sum;
    barrier();
    if (lane == 0u) {
        for (uint k = 1u; k < 64u; ++k) sum += sums[k];
        tile_parallax[gather.first_entry + entry] = sum.y / sum.x;
    }
}
