#version 460
// The first virtual point lights (Preiner 2010, 4.2): Halton points, moved to where the lamps' views are important by
// hierarchical warping (Clarberg et al. 2005). The atlas holds the views of all lamps, so that they share the lights by
// what they contribute.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"
#include "vpl/store.glsl"

layout(local_size_x = 64) in;

layout(binding = 0) uniform samplerBuffer lamp_places;
layout(binding = 1) uniform samplerBuffer lamp_normals;
layout(binding = 2) uniform samplerBuffer lamp_colors;
layout(binding = 3) uniform samplerBuffer importance;

float radical_inverse(uint index, uint base) {
    float digit = 1.0 / float(base), sum = 0.0, unit = digit;
    for (; index > 0u; index /= base) {
        sum += float(index % base) * unit;
        unit *= digit;
    }
    return sum;
}

// One of two by its share of their sum; what is left of the number is as even as it was.
bool second(inout float number, float a, float b) {
    float share = a / (a + b);
    bool beyond = number >= share;
    number = beyond ? (number - share) / (1.0 - share) : number / share;
    number = clamp(number, 0.0, 0.99999994);
    return beyond;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= lamp_pass.vpls) return;
    uint whole = lamp_pass.side * lamp_pass.light_size;
    uint level = uint(findMSB(whole));
    float total = texelFetch(importance, importance_level(level)).x;
    if (!(total > 0.0)) {
        store_vpl(index, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), vec3(0.0), NOTHING);
        return;
    }
    vec2 number = vec2(radical_inverse(index + 1u, 2u), radical_inverse(index + 1u, 3u));
    ivec2 cell = ivec2(0);
    while (level > 0u) {
        --level;
        int size = int(whole >> level);
        cell *= 2;
        int at = importance_level(level) + cell.y * size + cell.x;
        vec2 upper = vec2(texelFetch(importance, at).x, texelFetch(importance, at + 1).x);
        vec2 lower = vec2(texelFetch(importance, at + size).x, texelFetch(importance, at + size + 1).x);
        bool down = second(number.y, upper.x + upper.y, lower.x + lower.y);
        vec2 row = down ? lower : upper;
        cell += ivec2(second(number.x, row.x, row.y) ? 1 : 0, down ? 1 : 0);
    }
    // Rounding may lead to a pixel without importance, which then has no power either.
    int texel = cell.y * int(whole) + cell.x;
    uint bits = uint(findMSB(lamp_pass.light_size));
    LampView view = load_lamp_view(uint(cell.y >> bits) * lamp_pass.side + uint(cell.x >> bits));
    vec4 place = texelFetch(lamp_places, texel);
    vec4 normal = texelFetch(lamp_normals, texel);
    vec3 color = texelFetch(lamp_colors, texel).rgb;
    float chance = texelFetch(importance, texel).x / total * float(lamp_pass.vpls);
    float share = chance > 0.0 ? normal.w / chance : 0.0;
    vec3 towards = view.kind == SUN ? -view.forward : normalize(view.eye - place.xyz);
    float cosine = max(0.05, dot(normal.xyz, towards));
    vec3 from = place.xyz - view.eye;
    float area = share * (view.kind == SUN ? 1.0 : dot(from, from)) / cosine;
    Arriving arriving = Arriving(vec3(0.0), towards, view.strength * share, towards);
    store_vpl(index, place.xyz, area, normal.xyz, color, arriving);
}
