#version 460
// Technique `shared`: blocks of 4 x 4 pixels, each the sum over the texels of the tiles around it of radiance times
// BRDF (Sabbadin 2019, Eq. 9, with one buffer for many pixels). An invocation takes a block, so that every texel is
// read, and blended between tiles, once for 16 pixels; their sums stay in registers, which is why loops over them are
// written out. Texels know how far away their light is, so that tiles agree about its direction from the block, and
// pixels about theirs.
#extension GL_GOOGLE_include_directive : require
#include "shared/gather.glsl"
#include "common/receivers.glsl"
#include "common/brdf.glsl"
#include "common/lobe.glsl"
#include "common/octahedral.glsl"
#include "common/slots.glsl"
#include "common/surface.glsl"
#include "common/tile_texel.glsl"
#include "common/view.glsl"

layout(constant_id = 3) const uint SIZE = 34u;
layout(constant_id = 13) const bool SHARP = false; // some lobes have buffers of their own

layout(local_size_x = 32, local_size_x_id = 11) in;

layout(binding = 10) uniform usamplerBuffer block_tiles; // passes::tile_convolve::BlockTiles
layout(binding = 12) uniform usamplerBuffer texel_pairs; // lists of those above the horizon
layout(binding = 13) uniform usamplerBuffer tile_texels;
layout(binding = 15, rgba32f) uniform writeonly imageBuffer output_image;
// Reflectance over the hemisphere, by roughness and view cosine: x the diffuse term times pi, y the specular lobe,
// z the lobe times (1 - cos d)^5, w the lobe's tails.
layout(binding = 21) uniform sampler2D albedo_table;

const uint PAIRS = SIZE * SIZE / 2u;

// Sums of a pixel: radiance times BRDF, and the BRDF alone, by which they are divided: what the texels' finite number
// adds or lacks is the same in both.
struct Pixel {
    vec3 normal; // zero where nothing is covered
    vec3 view;
    vec3 offset; // from the block's middle
    float alpha2;
    float roughness;
    bool sharp; // its lobe has a buffer of its own, which leaves the tails
    float view_cosine;
    float rim; // (1 - cos o)^5
    vec3 normal_incidence; // Fresnel's term where the half vector is
    vec4 diffuse;
    vec4 lobe;
    float rim_lobe; // the BRDF's part that grows with (1 - cos d)^5
};

Pixel load_pixel(uint index, bool lit, vec3 block_middle) {
    Pixel pixel;
    vec4 position = receiver_sphere(index);
    bool covered = lit && position.w >= 0.0;
    pixel.normal = covered ? receiver_cone(index).xyz : vec3(0.0);
    pixel.view = covered ? view_of(position.xyz, pixel.normal) : vec3(0.0);
    pixel.offset = covered ? position.xyz - block_middle : vec3(0.0);
    pixel.view_cosine = dot(pixel.normal, pixel.view);
    pixel.roughness = 1.0;
    pixel.alpha2 = 1.0;
    pixel.normal_incidence = vec3(1.0);
    pixel.sharp = MATERIAL == 2u && gather.material_parameter < gather.sharp_alpha;
    if (MATERIAL == 0u && covered) {
        Surface surface = load_surface(texel_of(index));
        pixel.sharp = surface.sharp;
        pixel.roughness = surface.roughness;
        pixel.normal_incidence = mix(vec3(0.08 * surface.specular), surface.base_color, surface.metallic);
    }
    if (MATERIAL == 2u) pixel.roughness = sqrt(gather.material_parameter);
    float alpha = max(1e-3, pixel.roughness * pixel.roughness);
    pixel.alpha2 = alpha * alpha;
    pixel.rim = pow5(1.0 - pixel.view_cosine);
    pixel.diffuse = pixel.lobe = vec4(0.0);
    pixel.rim_lobe = 0.0;
    return pixel;
}

// Adds a texel with radiance.rgb from direction `light`, which the pixel's place has made a little longer or shorter;
// radiance.a is 1.
void add(inout Pixel pixel, vec3 light, vec4 radiance) {
    if (MATERIAL != 1u) light *= inversesqrt(dot(light, light) + 1e-12);
    float cosine = max(0.0, dot(pixel.normal, light));
    if (MATERIAL == 1u) {
        pixel.diffuse += radiance * cosine;
        return;
    }
    // With s = |l + v|^2: the distribution is alpha^2 / pi * (s / t)^2, masking over 4 cos i cos o is 1 / ((i + root i)
    // (o + root o)); what is the same for all texels cancels.
    float s = max(0.0, 2.0 + 2.0 * dot(pixel.view, light));
    float middle = cosine + pixel.view_cosine;
    float t = s - (1.0 - pixel.alpha2) * middle * middle + 1e-9;
    float root = sqrt(pixel.alpha2 + (1.0 - pixel.alpha2) * cosine * cosine);
    float lobe = cosine * s * s / (t * t * (cosine + root));
    if (SHARP && pixel.sharp) lobe *= 1.0 - lobe_weight(1.0 - pixel.alpha2 * middle * middle / t);
    if (MATERIAL == 2u) {
        pixel.lobe += radiance * lobe;
        return;
    }
    // cos^2 d is s / 4.
    float rim = lobe * pow5(1.0 - 0.5 * sqrt(s));
    pixel.lobe += radiance * vec4(pixel.normal_incidence * (lobe - rim) + rim, lobe);
    pixel.rim_lobe += rim;
    float grazing = 0.5 * s * pixel.roughness - 0.5;
    float diffuse = (1.0 + grazing * pow5(1.0 - cosine)) * (1.0 + grazing * pixel.rim);
    pixel.diffuse += radiance * (cosine * diffuse);
}

vec3 mean(vec4 sum) { return sum.rgb / max(sum.a, 1e-20); }

void finish(Pixel pixel, uint index) {
    if (pixel.normal == vec3(0.0)) return;
    ivec2 texel = texel_of(index);
    vec3 radiance;
    if (MATERIAL == 1u) {
        radiance = gather.material_parameter * mean(pixel.diffuse);
    } else {
        vec2 size = vec2(textureSize(albedo_table, 0));
        vec2 at = vec2(pixel.roughness, max(0.0, pixel.view_cosine)) * (1.0 - 1.0 / size) + 0.5 / size;
        vec4 albedo = textureLod(albedo_table, at, 0.0);
        if (pixel.sharp) albedo.yz *= albedo.w / max(albedo.y, 1e-4);
        if (MATERIAL == 2u) {
            radiance = albedo.y * mean(pixel.lobe);
        } else {
            Surface surface = load_surface(texel);
            vec3 exact = pixel.normal_incidence * (albedo.y - albedo.z) + albedo.z;
            vec3 summed = pixel.normal_incidence * (pixel.lobe.a - pixel.rim_lobe) + pixel.rim_lobe;
            radiance = exact * pixel.lobe.rgb / max(summed, vec3(1e-20))
                     + surface.base_color * ((1.0 - surface.metallic) * albedo.x) * mean(pixel.diffuse);
        }
    }
    radiance /= gather.radiance_scale;
    if (MATERIAL == 0u) radiance += load_surface(texel).emissive;
    imageStore(output_image, int(output_index(texel)), vec4(radiance, 1.0));
}

// Pixels in Morton order: index, column, row.
#define FOR_PIXELS(DO) \
    DO(0, 0, 0) DO(1, 1, 0) DO(2, 0, 1) DO(3, 1, 1) DO(4, 2, 0) DO(5, 3, 0) DO(6, 2, 1) DO(7, 3, 1) \
    DO(8, 0, 2) DO(9, 1, 2) DO(10, 0, 3) DO(11, 1, 3) DO(12, 2, 2) DO(13, 3, 2) DO(14, 2, 3) DO(15, 3, 3)

// Middles of the columns and rows of a block.
const float at_0 = 0.125, at_1 = 0.375, at_2 = 0.625, at_3 = 0.875;
#define ADD(k, i, j) add(pixel_##k, light_row_##j + (at_##i - centre.x) * light_x - near * pixel_##k.offset, \
                         vec4(row_##j + at_##i * slope_##j, 1.0));
#define ADD_ALL FOR_PIXELS(ADD)

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= gather.entry_count) return;
    int block = 10 * int(at);
    uvec4 tiles = texelFetch(block_tiles, block) * PAIRS;
    // Weights of the four tiles as polynomials of the place in the block: 1, x, y, x y.
    vec4 constant = uintBitsToFloat(texelFetch(block_tiles, block + 1));
    vec4 along_x = uintBitsToFloat(texelFetch(block_tiles, block + 2));
    vec4 along_y = uintBitsToFloat(texelFetch(block_tiles, block + 3));
    vec4 along_both = uintBitsToFloat(texelFetch(block_tiles, block + 4));
    // In the middle of what is lit, where the direction of the light is taken, and their slopes there.
    vec4 middle = uintBitsToFloat(texelFetch(block_tiles, block + 5));
    uvec4 work = texelFetch(block_tiles, block + 6);
    uint quadrant = uint(findLSB(work.y)) >> 2u;
    vec2 centre = work.y == 65535u ? vec2(0.5) : vec2(0.25) + 0.5 * vec2(quadrant & 1u, quadrant >> 1u);
    vec4 middle_x = along_x + centre.y * along_both;
    vec4 middle_y = along_y + centre.x * along_both;
    // From the block's middle to those of the tiles.
    vec4 offsets_x = uintBitsToFloat(texelFetch(block_tiles, block + 7));
    vec4 offsets_y = uintBitsToFloat(texelFetch(block_tiles, block + 8));
    vec4 offsets_z = uintBitsToFloat(texelFetch(block_tiles, block + 9));
    mat4x3 offsets = transpose(mat3x4(offsets_x, offsets_y, offsets_z));
    vec3 block_middle = receiver_sphere(receiver_slot(gather.pixels, receiver_code(2u, work.x))).xyz;
    uint first = work.x << 4u;
#define LOAD(k, i, j) Pixel pixel_##k = load_pixel(first + uint(k), (work.y >> uint(k) & 1u) != 0u, block_middle);
    FOR_PIXELS(LOAD)
    for (uint n = 0u; n < work.w; ++n) {
        uint k = texelFetch(texel_pairs, int(work.z + n)).x;
        uvec4 a = texelFetch(tile_texels, int(tiles.x + k));
        uvec4 b = texelFetch(tile_texels, int(tiles.y + k));
        uvec4 c = texelFetch(tile_texels, int(tiles.z + k));
        uvec4 d = texelFetch(tile_texels, int(tiles.w + k));
// Radiance in the four rows of the block at x = 0, and its slope along them.
#define ROW(j) \
        vec3 row_##j = base + at_##j * rise; \
        vec3 slope_##j = run + at_##j * twist; \
        vec3 light_row_##j = light + (at_##j - centre.y) * light_y;
#define LIGHT(m) \
        vec3 light_##m = octahedral_direction((corner + texel_middle(packed_##m)) / float(SIZE)); \
        float near_##m = texel_inverse_distance(packed_##m);
#define TEXEL(R, P, OFFSET) { \
        mat4x3 four = mat4x3(texel_radiance(a.R), texel_radiance(b.R), texel_radiance(c.R), texel_radiance(d.R)); \
        vec2 corner = vec2((2u * k) % SIZE + OFFSET, (2u * k) / SIZE); \
        uint packed_0 = a.P, packed_1 = b.P, packed_2 = c.P, packed_3 = d.P; \
        LIGHT(0) LIGHT(1) LIGHT(2) LIGHT(3) \
        vec4 near_all = vec4(near_0, near_1, near_2, near_3); \
        mat4x3 lights = mat4x3(light_0 + near_0 * offsets[0], light_1 + near_1 * offsets[1], \
                               light_2 + near_2 * offsets[2], light_3 + near_3 * offsets[3]); \
        vec4 shine = vec3(1.0) * four + 1e-12; \
        vec4 share = middle * shine, share_x = middle_x * shine, share_y = middle_y * shine; \
        float all = 1.0 / (share.x + share.y + share.z + share.w); \
        vec3 light = lights * share * all; \
        float near = dot(near_all, share) * all; \
        vec3 light_x = (lights * share_x - light * (share_x.x + share_x.y + share_x.z + share_x.w)) * all; \
        vec3 light_y = (lights * share_y - light * (share_y.x + share_y.y + share_y.z + share_y.w)) * all; \
        vec3 base = four * constant, run = four * along_x, rise = four * along_y, twist = four * along_both; \
        ROW(0) ROW(1) ROW(2) ROW(3) \
        ADD_ALL }
        TEXEL(x, y, 0u)
        TEXEL(z, w, 1u)
    }
#define FINISH(k, i, j) finish(pixel_##k, first + uint(k));
    FOR_PIXELS(FINISH)
}
