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
#include "common/vpl.glsl"
#include "common/vpl_visible.glsl"
#include "common/lamp_direct.glsl"

const uint GROUP = 64u;
layout(local_size_x = GROUP) in;

layout(binding = 2, rgba32f) uniform imageBuffer radiance;

layout(constant_id = 0) const bool GLOSSY = false;
// The lamps themselves.
layout(constant_id = 1) const bool DIRECT = false;

vec3 direct(Surfel surfel) {
    vec3 irradiance = vec3(0.0), towards;
    for (uint k = 0u; k < lamp_pass.views; ++k) irradiance += lamp_irradiance(k, surfel.position, surfel.normal, towards);
    return irradiance;
}

vec3 bounced(Surfel surfel, uint part, uint parts) {
    uint count = lamp_pass.vpls / parts;
    vec3 irradiance = vec3(0.0);
    for (uint k = part * count; k < (part + 1u) * count; ++k) {
        Vpl light = load_vpl(k);
        vec3 to = surfel.position - light.position;
        float distance2 = dot(to, to);
        float cosines = dot(to, light.normal) * -dot(to, surfel.normal);
        if (dot(to, light.normal) <= 0.0 || cosines <= 0.0) continue;
        mat3 frame = frame_of(light.normal);
        float distance_ = sqrt(distance2);
        if (!vpl_sees(k, to * frame, distance_, surfel.normal * frame)) continue;
        vec3 intensity = light.diffuse;
        if (GLOSSY) intensity += glossy_intensity(k, light.normal, to / distance_);
        irradiance += intensity * (cosines / (distance2 * (distance2 + near_bound(light))));
    }
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
