#version 460
// A pixel of an object that a probe lights: Lambert's reflection of the irradiance (Hajisharif et al. 2012, Eq. 2), and
// what the surface mirrors: a GGX lobe over the probe's pyramid, or the paper's own mirror term (Eq. 15). Wide lobes are
// summed over all texels of a coarse level, which no lamp can hide from; narrow ones are sampled, each sample from the
// level that is as coarse as it (Krivanek and Colbert 2008, GPU-Based Importance Sampling).
#extension GL_GOOGLE_include_directive : require
#include "shared/probe_shade.glsl"
#include "common/brdf.glsl"
#include "common/surface.glsl"
#include "common/view.glsl"
#include "common/probe_lookup.glsl"

layout(local_size_x = 64) in;

// What is mirrored: nothing, the lobe, or Eq. 15's perfect mirror.
const uint NONE = 0u;
const uint LOBES = 1u;
const uint MIRROR = 2u;
layout(constant_id = 3) const uint REFLECTION = 1u;
layout(constant_id = 4) const uint SAMPLES = 16u;

layout(binding = 0) uniform sampler2D position_map;
layout(binding = 1) uniform sampler2D irradiance_map;
layout(binding = 15, rgba32f) uniform writeonly imageBuffer output_image;

// Normal of a microfacet with the density in which the eye sees them (Heitz 2018, listing 1); z is the surface's normal.
vec3 visible_normal(vec3 view, float alpha, vec2 square) {
    vec3 stretched = normalize(vec3(alpha * view.xy, view.z));
    float length2 = dot(stretched.xy, stretched.xy);
    vec3 first = length2 > 0.0 ? vec3(-stretched.y, stretched.x, 0.0) * inversesqrt(length2) : vec3(1.0, 0.0, 0.0);
    vec3 second = cross(stretched, first);
    float radius = sqrt(square.x);
    float angle = 2.0 * PI * square.y;
    float x = radius * cos(angle);
    float y = radius * sin(angle);
    float raised = 0.5 * (1.0 + stretched.z);
    y = (1.0 - raised) * sqrt(max(0.0, 1.0 - x * x)) + raised * y;
    vec3 m = first * x + second * y + stretched * sqrt(max(0.0, 1.0 - x * x - y * y));
    return normalize(vec3(alpha * m.xy, max(1e-6, m.z)));
}

// From these GGX alphas on lobes are wide: texels of a level with about so many columns, or half of them, are small.
const float WIDE = 0.18;
const float WIDER = 0.36;
const uint COLUMNS = SAMPLES < 32u ? 32u : 64u;
// Lobes that reflect less than this at normal incidence are not what one looks at: half the columns do.
const float STRONG = 0.25;

// Light that a wide GGX lobe reflects to the eye, from all texels of the level with about so many columns.
vec3 wide_lobe_light(vec3 normal, vec3 view, float alpha, vec3 normal_incidence, uint columns) {
    uint index = uint(probe_levels.length()) - 1u;
    while (index > 0u && 10u * probe_levels[index].x < 7u * columns) --index;
    uvec4 level = probe_levels[index];
    float step_down = PI / float(level.y);
    float step_around = 2.0 * PI / float(level.x);
    vec2 turn = vec2(sin(step_around), cos(step_around));
    float alpha2 = alpha * alpha;
    float view_cosine = dot(normal, view);
    vec3 base = vec3(0.0);   // of Fresnel's term: the part that does not depend on the angle
    vec3 grazing = vec3(0.0);
    int texel = int(level.z);
    for (uint row = 0u; row < level.y; ++row) {
        float down = (float(row) + 0.5) * step_down;
        float across = sin(down);
        float height = cos(down);
        // Sine and cosine of the way around from -Z, turned from column to column.
        vec2 around = vec2(sin(0.5 * step_around - PI), cos(0.5 * step_around - PI));
        vec2 normal_across = across * vec2(normal.x, -normal.z), view_across = across * vec2(view.x, -view.z);
        float normal_height = normal.y * height, view_height = view.y * height;
        vec3 row_base = vec3(0.0), row_grazing = vec3(0.0);
        for (uint column = 0u; column < level.x; ++column, ++texel) {
            float i = dot(normal_across, around) + normal_height;
            float between = dot(view_across, around) + view_height;
            around = vec2(around.x * turn.y + around.y * turn.x, around.y * turn.y - around.x * turn.x);
            if (i <= 0.0) continue;
            // The half vector's length is the root of 2 + 2 between: its cosines need no vector.
            float inverse = inversesqrt(max(1e-6, 2.0 + 2.0 * between));
            float h = (i + view_cosine) * inverse;
            float away = 1.0 - (1.0 + between) * inverse;
            float t = h * h * (alpha2 - 1.0) + 1.0;
            // Distribution and masking of the light's side, but for constants (as in common/brdf.glsl).
            float lobe = i / (t * t * (i + sqrt(alpha2 + (1.0 - alpha2) * i * i)));
            vec3 light = texelFetch(probe_texels, texel).rgb * lobe;
            float away2 = away * away;
            row_base += light;
            row_grazing += light * (away2 * away2 * away);
        }
        base += row_base * across;
        grazing += row_grazing * across;
    }
    float ring = step_around * 2.0 * sin(0.5 * step_down);
    float constants = alpha2 / PI * 2.0 * smith_masking(view_cosine, alpha) / (4.0 * view_cosine);
    return (normal_incidence * (base - grazing) + grazing) * (ring * constants);
}

// The same of a narrow lobe, by samples.
vec3 lobe_light(vec3 normal, vec3 view, float alpha, vec3 normal_incidence) {
    float side = normal.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (side + normal.z);
    float b = normal.x * normal.y * a;
    vec3 tangent = vec3(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    vec3 bitangent = vec3(b, side + normal.y * normal.y * a, -normal.y);
    vec3 local = vec3(dot(tangent, view), dot(bitangent, view), dot(normal, view));
    vec3 sum = vec3(0.0);
    for (uint k = 0u; k < SAMPLES; ++k) {
        // Hammersley's points: even along one side, bits in reverse along the other.
        vec2 square = vec2((float(k) + 0.5) / float(SAMPLES), float(bitfieldReverse(k)) * 2.3283064e-10);
        vec3 h = visible_normal(local, alpha, square);
        float d = dot(local, h);
        vec3 light = 2.0 * d * h - local;
        if (light.z <= 0.0) continue;
        float density = ggx_distribution(h.z, alpha) * smith_masking(local.z, alpha) / (4.0 * local.z);
        vec3 fresnel = mix(normal_incidence, vec3(1.0), pow5(1.0 - d));
        vec3 world = tangent * light.x + bitangent * light.y + normal * light.z;
        sum += fresnel * smith_masking(light.z, alpha) * probe_radiance(world, 1.0 / (float(SAMPLES) * density));
    }
    return sum / float(SAMPLES);
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= gather.width * gather.height) return;
    ivec2 texel = ivec2(at % gather.width, at / gather.width);
    vec4 position = texelFetch(position_map, texel, 0);
    if (position.w == 0.0) {
        imageStore(output_image, int(at), vec4(0.0));
        return;
    }
    Surface surface = load_surface(texel);
    vec4 irradiance = texelFetch(irradiance_map, texel, 0);
    vec3 normal = texelFetch(normal_map, texel, 0).xyz;
    vec3 view = view_of(position.xyz, normal);
    vec3 albedo = MATERIAL == 1u ? vec3(gather.material_parameter)
                : MATERIAL == 2u ? vec3(0.0)
                : surface.base_color * (1.0 - surface.metallic);
    vec3 radiance = albedo / PI * irradiance.rgb;
    // What of the surround is seen, towards the mirror image (Lagarde and de Rousiers 2014, Moving Frostbite to PBR).
    float roughness = MATERIAL == 2u ? sqrt(gather.material_parameter) : surface.roughness;
    float view_cosine = dot(normal, view);
    float seen = clamp(pow(view_cosine + irradiance.a, exp2(-16.0 * roughness - 1.0)) - 1.0 + irradiance.a, 0.0, 1.0);
    if (REFLECTION == MIRROR) {
        radiance += gather.mirror * probe_radiance(2.0 * view_cosine * normal - view, 0.0);
    } else if (REFLECTION == LOBES && MATERIAL != 1u) {
        float alpha = MATERIAL == 2u ? gather.material_parameter : max(1e-3, surface.roughness * surface.roughness);
        vec3 normal_incidence =
            MATERIAL == 2u ? vec3(1.0) : mix(vec3(0.08 * surface.specular), surface.base_color, surface.metallic);
        if (alpha < WIDE) {
            radiance += seen * lobe_light(normal, view, alpha, normal_incidence);
        } else {
            bool strong = max(max(normal_incidence.r, normal_incidence.g), normal_incidence.b) >= STRONG;
            uint columns = (alpha < WIDER ? COLUMNS : COLUMNS / 2u) / (strong ? 1u : 2u);
            radiance += seen * wide_lobe_light(normal, view, alpha, normal_incidence, columns);
        }
    }
    if (MATERIAL == 0u) radiance += surface.emissive;
    imageStore(output_image, int(at), vec4(radiance, 1.0));
}
