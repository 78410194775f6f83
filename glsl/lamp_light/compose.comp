#version 460
// The picture: direct light, and bounced light after the filter that knows geometry (Preiner 2010, section 3; Keller and
// Heidrich 2001): over a window of interleave^2 pixels, which holds every part of the lights once, those on the same
// surface.
#extension GL_GOOGLE_include_directive : require
#include "lamp_light/pixel.glsl"

layout(local_size_x = 64) in;

layout(binding = 2) uniform samplerBuffer direct_in;
layout(binding = 3) uniform samplerBuffer bounced_in;
layout(binding = 4) uniform samplerBuffer glossy_in;
layout(binding = 5, rgba32f) uniform writeonly imageBuffer lit_out; // radiance, depth
layout(binding = 6, rgba32f) uniform writeonly imageBuffer smooth_out; // bounced irradiance

const float SAME_NORMAL = 0.9;
// Distance from the pixel's plane, of its depth.
const float SAME_PLANE = 0.02;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= lamp_pass.width * lamp_pass.height) return;
    ivec2 at = ivec2(index % lamp_pass.width, index / lamp_pass.width);
    Pixel pixel = load_pixel(at);
    vec3 irradiance = vec3(0.0), lobes = vec3(0.0);
    int reach = int(lamp_pass.interleave);
    float weights = 0.0;
    ivec2 last = ivec2(lamp_pass.width, lamp_pass.height) - 1;
    for (int y = -reach / 2; y < (reach + 1) / 2; ++y) {
        for (int x = -reach / 2; x < (reach + 1) / 2; ++x) {
            ivec2 wanted = at + ivec2(x, y);
            ivec2 beside = clamp(wanted, ivec2(0), last);
            Pixel other = load_pixel(beside);
            bool same = other.depth > 0.0 && dot(other.normal, pixel.normal) >= SAME_NORMAL
                     && abs(dot(other.position - pixel.position, pixel.normal)) <= SAME_PLANE * pixel.depth;
            float weight = wanted == beside && (same || beside == at) ? 1.0 : 0.0;
            int slot = beside.y * int(lamp_pass.width) + beside.x;
            irradiance += texelFetch(bounced_in, slot).rgb * weight;
            lobes += texelFetch(glossy_in, slot).rgb * weight;
            weights += weight;
        }
    }
    irradiance /= max(weights, 1.0);
    lobes /= max(weights, 1.0);
    vec3 all = irradiance + texelFetch(direct_in, int(index)).rgb;
    vec3 radiance = all * albedo_of(pixel.color) * (surfaces_of(pixel.color).diffuse * 0.318309886) + lobes;
    imageStore(lit_out, int(index), vec4(radiance, pixel.depth));
    imageStore(smooth_out, int(index), vec4(irradiance, 1.0));
}
