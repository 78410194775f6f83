#version 460
// Light of one bounce at every pixel (Preiner 2010, 4.4) with interleaved sampling (Keller and Heidrich 2001): a pixel takes
// the lights of one of interleave^2 parts, and pixels of a part lie side by side in the dispatch, so that they all
// read the same lights; the split G-buffer is a matter of addresses, and so is the merge.
#extension GL_GOOGLE_include_directive : require
#include "lamp_light/pixel.glsl"
#include "common/vpl_light.glsl"

const uint GROUP = 64u;
layout(local_size_x = GROUP) in;

layout(binding = 2, rgba32f) uniform imageBuffer bounced; // irradiance
layout(binding = 3, rgba32f) uniform imageBuffer glossy;  // radiance of the mirror lobes

void main() {
    uint interleave = lamp_pass.interleave, parts = interleave * interleave;
    uint columns = (lamp_pass.width + interleave - 1u) / interleave;
    uint rows = (lamp_pass.height + interleave - 1u) / interleave;
    uint groups = (columns * rows + GROUP - 1u) / GROUP;
    uint part = gl_WorkGroupID.x / groups;
    uint index = (gl_WorkGroupID.x - part * groups) * GROUP + gl_LocalInvocationIndex;
    uint row = index / columns;
    ivec2 at = ivec2((index - row * columns) * interleave + part % interleave, row * interleave + part / interleave);
    if (at.x >= int(lamp_pass.width) || at.y >= int(lamp_pass.height) || row >= rows) return;
    Pixel pixel = load_pixel(at);
    if (pixel.depth == 0.0) return;
    Surfaces surfaces = surfaces_of(pixel.color);

    // Runs of lights: a run of Halton points is even, every n-th of them is not.
    uint count = lamp_pass.vpls / parts;
    vec3 irradiance = vec3(0.0), lobes = vec3(0.0);
    for (uint k = part * count; k < (part + 1u) * count; ++k) {
        vec3 direction;
        vec3 light = vpl_irradiance(k, pixel.position, pixel.normal, direction);
        if (light == vec3(0.0)) continue;
        irradiance += light;
        if (GLOSSY) lobes += light * phong(surfaces, pixel.normal, -direction, pixel.to_eye);
    }
    int slot = at.y * int(lamp_pass.width) + at.x;
    imageStore(bounced, slot, imageLoad(bounced, slot) + vec4(irradiance * float(parts), 0.0));
    if (GLOSSY) imageStore(glossy, slot, imageLoad(glossy, slot) + vec4(lobes * float(parts), 0.0));
}
