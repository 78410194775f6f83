#version 460
// Direct light of all lamps by their shadow maps (Preiner 2010, section 3).
#extension GL_GOOGLE_include_directive : require
#include "lamp_light/pixel.glsl"

layout(local_size_x = 64) in;

layout(binding = 2) uniform samplerBuffer lamp_places;
layout(binding = 3, rgba32f) uniform writeonly imageBuffer direct_out; // irradiance
layout(binding = 4, rgba32f) uniform writeonly imageBuffer glossy_out; // radiance of the mirror lobes
layout(binding = 5, rgba32f) uniform writeonly imageBuffer bounced_out;

layout(constant_id = 0) const bool GLOSSY = false;

// Widths of a texel that an occluder must be nearer; a sun's view has its depths a long way off.
const float BIAS = 3.0;

// Share of four texels around the place in the view that see the pixel's plane.
float lit_share(uint index, LampView view, vec3 local, Pixel pixel) {
    vec3 normal = vec3(dot(pixel.normal, view.right), dot(pixel.normal, view.down), dot(pixel.normal, view.forward));
    vec2 place = local.xy / local.z * view.focal + 0.5 * float(lamp_pass.light_size) - 0.5;
    vec2 corner = floor(place), part = place - corner;
    float share = 0.0;
    for (int k = 0; k < 4; ++k) {
        ivec2 side = ivec2(k & 1, k >> 1);
        ivec2 at = clamp(ivec2(corner) + side, ivec2(0), ivec2(lamp_pass.light_size) - 1);
        float depth = texelFetch(lamp_places, lamp_texel(index, at)).w;
        vec3 ray = vec3((vec2(at) + 0.5 - 0.5 * float(lamp_pass.light_size)) / view.focal, 1.0);
        float towards = dot(normal, ray);
        float planar = towards < 0.0 ? dot(normal, local) / towards : local.z;
        bool lit = depth == 0.0 || clamp(planar, 0.5 * local.z, local.z) - BIAS * local.z / view.focal <= depth;
        vec2 shares = mix(1.0 - part, part, vec2(side));
        if (lit) share += shares.x * shares.y;
    }
    return share;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= lamp_pass.width * lamp_pass.height) return;
    Pixel pixel = load_pixel(ivec2(index % lamp_pass.width, index / lamp_pass.width));
    Surfaces surfaces = load_surfaces();
    vec3 irradiance = vec3(0.0), glossy = vec3(0.0);
    for (uint k = 0u; k < lamp_pass.views && pixel.depth > 0.0; ++k) {
        LampView view = load_lamp_view(k);
        vec3 from = pixel.position - view.eye;
        vec3 local = vec3(dot(from, view.right), dot(from, view.down), dot(from, view.forward));
        // Points have six views that touch.
        bool inside = local.z > 0.0 && max(abs(local.x), abs(local.y)) * view.focal <= 0.5 * float(lamp_pass.light_size) * local.z;
        float distance2 = dot(from, from);
        if (!inside || (view.kind == SPOT && local.z < view.cone * sqrt(distance2))) continue;
        vec3 towards = view.kind == SUN ? -view.forward : -from * inversesqrt(distance2);
        float cosine = dot(pixel.normal, towards);
        if (cosine <= 0.0) continue;
        vec3 light = view.strength * (cosine * lit_share(k, view, local, pixel) / (view.kind == SUN ? 1.0 : distance2));
        irradiance += light;
        if (GLOSSY) glossy += light * phong(surfaces, pixel.normal, towards, pixel.to_eye);
    }
    imageStore(direct_out, int(index), vec4(irradiance, 1.0));
    imageStore(glossy_out, int(index), vec4(glossy, 1.0));
    imageStore(bounced_out, int(index), vec4(0.0));
}
