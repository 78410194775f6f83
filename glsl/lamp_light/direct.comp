#version 460
// Direct light of all lamps by their shadow maps (Preiner 2010, section 3).
#extension GL_GOOGLE_include_directive : require
#include "lamp_light/pixel.glsl"

layout(local_size_x = 64) in;

layout(binding = 3, rgba32f) uniform writeonly imageBuffer direct_out; // irradiance
layout(binding = 4, rgba32f) uniform writeonly imageBuffer glossy_out; // radiance of the mirror lobes
layout(binding = 5, rgba32f) uniform writeonly imageBuffer bounced_out;

layout(constant_id = 0) const bool GLOSSY = false;

#include "common/lamp_direct.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= lamp_pass.width * lamp_pass.height) return;
    Pixel pixel = load_pixel(ivec2(index % lamp_pass.width, index / lamp_pass.width));
    Surfaces surfaces = surfaces_of(pixel.color);
    vec3 irradiance = vec3(0.0), glossy = vec3(0.0);
    for (uint k = 0u; k < lamp_pass.views && pixel.depth > 0.0; ++k) {
        vec3 towards;
        vec3 light = lamp_irradiance(k, pixel.position, pixel.normal, towards);
        irradiance += light;
        if (GLOSSY) glossy += light * phong(surfaces, pixel.normal, towards, pixel.to_eye);
    }
    imageStore(direct_out, int(index), vec4(irradiance, 1.0));
    imageStore(glossy_out, int(index), vec4(glossy, 1.0));
    imageStore(bounced_out, int(index), vec4(0.0));
}
