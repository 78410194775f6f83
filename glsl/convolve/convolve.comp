#version 460
// The last pass (Sabbadin 2019, 5.3, Eq. 9): a pixel's micro-buffer times its BRDF, with the true projected solid
// angle of every micro-pixel (Eq. 5 gives all the same solid angle and comes out 4.7 % too bright; `--paper weights`).
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "shared/gather.glsl"
#include "common/hierarchy.glsl"
#include "common/receivers.glsl"
#include "common/microbuffer.glsl"
#include "common/sums.glsl"
#include "common/brdf.glsl"
#include "common/far_field.glsl"
#include "common/slots.glsl"
#include "common/surface.glsl"

layout(constant_id = 5) const bool ONE_NODE = false;      // colours come from the nearest node alone
layout(constant_id = 6) const bool IMAGE_STORE = false;   // ... as the paper's image holds it
layout(constant_id = 7) const bool PAPER_WEIGHTS = false; // Eq. 5
layout(constant_id = 13) const bool SHARP = false; // some lobes have buffers of their own
layout(constant_id = 9) const uint SUBSAMPLES = 1u;       // BRDF evaluations along a side of a micro-pixel

layout(local_size_x = 64) in;

layout(std430, binding = 10) readonly buffer Nearest { uint64_t nearest[]; };
layout(binding = 11) uniform usamplerBuffer layers;
layout(binding = 12, rgba16f) uniform readonly image2D store;
// Direction of the middle of a micro-pixel's part inside the disc, and that part's area (1 where it is whole). Only
// the micro-pixels that the disc touches, with their index.
layout(binding = 13) uniform samplerBuffer micro_directions;
layout(binding = 14) uniform usamplerBuffer micro_indices;
layout(binding = 15, rgba32f) uniform writeonly imageBuffer output_image;
layout(std430, binding = 16) buffer ConvolveCounts { uint overflowed; };

// A front layer that covers this share of a micro-pixel hides what lies behind; a smaller one lets the rest show.
// The discs of lobes see single points, which cover their surface unevenly.
const float OPAQUE = LOBE ? 0.25 : 0.75;
// The covered radiance of an opaque front layer is summed as it is. Dividing by the covered share would move a lamp's
// energy when it straddles micro-pixels, and halve a lamp that hangs close to a ceiling. What plain sums lack or have
// too much in all, because footprints overlap unevenly and lean over the rim, is made good for the hemisphere as a whole.

// Covered radiance of a micro-pixel; negative where no node covers it. `whole` is its area inside the disc, `counted`
// the share of it that the radiance stands for.
vec3 micro_radiance(uint at, uint micro, float whole, out float counted) {
    counted = 1.0;
    if (IMAGE_STORE) {
        uint buffer_index = at / MICRO_PIXELS;
        ivec2 corner = ivec2(uvec2(buffer_index % gather.store_columns, buffer_index / gather.store_columns) * SIZE);
        vec4 stored = imageLoad(store, corner + ivec2(micro % SIZE, micro / SIZE));
        return stored.a > 0.0 ? stored.rgb : vec3(-1.0);
    }
    if (ONE_NODE) {
        uint64_t key = nearest[at + micro];
        return uint(key >> 32) < 0x7f7fffffu ? node_mean(uint(key)) : vec3(-1.0);
    }
    uvec4 front = texelFetch(layers, int(2u * (at + micro)));
    uvec4 back = texelFetch(layers, int(2u * (at + micro) + 1u));
    vec2 coverage = vec2(front.a, back.a) / COVERAGE_ONE;
    if (coverage.x + coverage.y == 0.0) return vec3(-1.0);
    if (max(coverage.x, coverage.y) > gather.coverage_limit) overflowed = 1u;
    vec3 front_mean = vec3(front.rgb) / max(1e-9, gather.color_scale * coverage.x);
    vec3 back_mean = vec3(back.rgb) / max(1e-9, gather.color_scale * coverage.y);
    float opaque = coverage.y > 0.0 ? min(1.0, coverage.x / (OPAQUE * whole)) : 1.0;
    float share = coverage.x / whole;
    float kept = opaque == 1.0 ? share : opaque;
    counted = kept + (1.0 - opaque);
    return front_mean * kept + back_mean * (1.0 - opaque);
}

vec3 reflectance(Surface surface, vec3 normal, vec3 light, vec3 view) {
    if (MATERIAL == 1u) return vec3(gather.material_parameter / PI);
    Angles angles = angles_of(normal, light, view);
    if (angles.i <= 0.0 || angles.o <= 0.0) return vec3(0.0);
    float alpha = MATERIAL == 2u ? gather.material_parameter : max(1e-3, surface.roughness * surface.roughness);
    // A lobe with a buffer of its own leaves its tails.
    float kept = SHARP && surface.sharp ? 1.0 - lobe_weight_of(angles.h, alpha * alpha) : 1.0;
    if (MATERIAL == 2u) return vec3(ggx_lobe(angles, alpha) * kept);
    return principled(angles, surface.base_color, surface.metallic, surface.roughness, surface.specular, kept);
}

// Mean reflectance over a micro-pixel: the lobe may be narrower than it.
vec3 mean_reflectance(Surface surface, Site site, uint micro, vec3 light_middle, vec3 view) {
    if (SUBSAMPLES == 1u) return reflectance(surface, site.normal, light_middle, view);
    vec3 sum = vec3(0.0);
    float count = 0.0;
    const float cell = 2.0 / float(SIZE);
    vec2 corner = vec2(micro % SIZE, micro / SIZE) * cell - 1.0;
    for (uint k = 0u; k < SUBSAMPLES * SUBSAMPLES; ++k) {
        vec2 disc = corner + (vec2(k % SUBSAMPLES, k / SUBSAMPLES) + 0.5) * (cell / float(SUBSAMPLES));
        float rest = 1.0 - dot(disc, disc);
        if (rest <= 0.0) continue;
        vec3 light = site.tangent * disc.x + site.bitangent * disc.y + site.normal * sqrt(rest);
        sum += reflectance(surface, site.normal, light, view);
        count += 1.0;
    }
    return count > 0.0 ? sum / count : reflectance(surface, site.normal, light_middle, view);
}

// What the part of a lobe's disc around `middle` reflects of its light, which comes from `light`: the share of the
// distribution there times masking, Fresnel and the rest of Walter et al. 2007, Eq. 41.
vec3 lobe_reflectance(Surface surface, Site site, vec2 middle, out vec3 light) {
    float share = min(dot(middle, middle), 1.0) * LOBE_SHARE;
    vec2 slope = middle * sqrt(site.lobe.alpha2 * LOBE_SHARE / (1.0 - share));
    vec3 h = normalize(site.tangent * slope.x + site.bitangent * slope.y + site.normal);
    float along = dot(site.lobe.view, h);
    light = 2.0 * along * h - site.lobe.view;
    float i = dot(site.normal, light);
    if (i <= 0.0 || along <= 0.0) {
        light = site.normal;
        return vec3(0.0);
    }
    float alpha = sqrt(site.lobe.alpha2);
    float weight = smith_masking(i, alpha) * smith_masking(site.lobe.view_cosine, alpha) * along
                 / (site.lobe.view_cosine * dot(site.normal, h)) * lobe_weight(share) * (LOBE_SHARE / PI);
    if (MATERIAL == 2u) return vec3(weight);
    vec3 normal_incidence = mix(vec3(0.08 * surface.specular), surface.base_color, surface.metallic);
    return mix(normal_incidence, vec3(1.0), pow5(1.0 - along)) * weight;
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= gather.entry_count) return;
    uint pixel = entries[gather.first_entry + at];
    Site site = load_site(pixel, gather.first_entry + at);
    ivec2 texel = texel_of(pixel);
    Surface surface = load_surface(texel);
    vec3 view = view_of(site.position, site.normal);

    uint start = at * MICRO_PIXELS;
    const float cell_area = 4.0 / float(MICRO_PIXELS); // of the disc, whose area is pi
    vec3 radiance = vec3(0.0);
    vec3 all = vec3(0.0); // reflectance over the hemisphere
    vec3 seen = vec3(0.0); // ... and over the shares that the radiance stands for
    // Mean radiance by reflected share, where bright light counts less (Karis 2013, Tone Mapping, as for antialiasing).
    vec3 tame = vec3(0.0);
    float tame_weight = 1e-20;
    for (int m = 0; m < textureSize(micro_directions); ++m) {
        uint micro = texelFetch(micro_indices, m).x;
        vec4 middle = texelFetch(micro_directions, m);
        vec3 light = site.tangent * middle.x + site.bitangent * middle.y + site.normal * middle.z;
        vec3 lobe = LOBE ? lobe_reflectance(surface, site, middle.xy, light) : vec3(0.0);
        float solid_angle = middle.w * cell_area
                          / (LOBE ? PI * lobe_density(site.lobe, site.normal, light) : max(middle.z, 0.02));
        float counted;
        vec3 incoming = micro_radiance(start, micro, middle.w, counted);
        if (incoming.x < 0.0) incoming = far_radiance(light, solid_angle);
        // Projected solid angle: exact, or Eq. 5's 2 pi / size^2 times the cosine, where the centre is on the disc.
        vec2 centre = (vec2(micro % SIZE, micro / SIZE) + 0.5) * (2.0 / float(SIZE)) - 1.0;
        float paper_weight = 2.0 * PI / float(MICRO_PIXELS) * sqrt(max(0.0, 1.0 - dot(centre, centre)));
        float weight = PAPER_WEIGHTS ? paper_weight : middle.w * cell_area;
        vec3 reflected = (LOBE ? lobe : mean_reflectance(surface, site, micro, light, view)) * weight;
        radiance += incoming * reflected;
        all += reflected;
        seen += counted * reflected;
        float brightness = luminance(incoming) / max(counted, 1e-6);
        float share = counted * luminance(reflected) * gather.typical / (gather.typical + brightness);
        tame += share / max(counted, 1e-6) * incoming;
        tame_weight += share;
    }
    // What plain sums lack or have too much is ordinary light: taken from all in proportion, it would change lamps, whose
    // sums are right.
    radiance = max(vec3(0.0), radiance + (all - seen) * tame / tame_weight);
    if (MATERIAL == 0u && !LOBE) radiance += surface.emissive;
    imageStore(output_image, int(output_index(texel)), vec4(radiance, 1.0));
}
