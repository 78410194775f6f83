#version 460
// Light of lamps at points of the cloud: what the lamps themselves send, or the lights of one bounce. The points keep one
// sum each of the radiance that they send on, alike in all directions: what their lobes reflect counts as diffuse. Points
// take the lights of one of interleave^2 parts, those beside each other in the hierarchy different ones, so that a
// node above them has all.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/rgb9e5.glsl"
#include "common/lamp_setup.glsl"
#include "common/surfel.glsl"
#include "common/vpl_light.glsl"
#include "common/lamp_direct.glsl"

const uint GROUP = 64u;
layout(local_size_x = GROUP) in;

layout(binding = 2, rgba32f) uniform imageBuffer radiance;

// The lamps themselves.
layout(constant_id = 1) const bool DIRECT = false;

vec3 direct(Surfel surfel) {
    vec3 irradiance = vec3(0.0), towards;
    for (uint k = 0u; k < lamp_pass.views; ++k) irradiance += lamp_irradiance(k, surfel.position, surfel.normal, towards);
    return irradiance;
}

vec3 bounced(Surfel surfel, uint part, uint parts) {
    uint count = lamp_pass.vpls / parts;
    vec3 irradiance = vec3(0.0), direction;
    for (uint k = part * count; k < (part + 1u) * count; ++k)
        irradiance += vpl_irradiance(k, surfel.position, surfel.normal, direction);
    return irradiance * float(parts);
}

void main() {
    uint parts = lamp_pass.interleave * lamp_pass.interleave;
    // A workgroup has every `parts`th point of a run.
    uint run = gl_WorkGroupID.x / parts, part = gl_WorkGroupID.x - run * parts;
    uint offset = (run * GROUP + gl_LocalInvocationIndex) * parts + part;
    if (offset >= lamp_pass.count) return;
    uint index = lamp_pass.first + offset;
    Surfel surfel = load_surfel(int(index));
    Surfaces surfaces = surfaces_of(surfel.color);
    vec3 reflected = (albedo_of(surfel.color) * surfaces.diffuse + surfaces.specular) * 0.318309886;
    if (DIRECT) imageStore(radiance, int(index), vec4(direct(surfel) * reflected, 0.0));
    else imageStore(radiance, int(index), imageLoad(radiance, int(index)) + vec4(bounced(surfel, part, parts) * reflected, 0.0));
}
