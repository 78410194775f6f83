#version 460
// The G-buffer, and the irradiance of every pixel.
#extension GL_GOOGLE_include_directive : require
#include "shared/draw.glsl"
#include "common/gbuffer_surface.glsl"
#include "common/harmonics.glsl"

layout(constant_id = 2) const bool TRANSFER = true; // vertices have one

layout(location = 4) in vec4 irradiance; // by transfer; w: what of a white surround is seen
layout(location = 4) out vec4 out_irradiance;

void main() {
    Fragment fragment = write_surface();
    vec3 open = max(vec3(0.0), open_irradiance(fragment.normal));
    // A transfer is that of the side where the vertices' normals point.
    if (!TRANSFER || fragment.turned) {
        out_irradiance = vec4(open, 1.0);
        return;
    }
    vec3 seen = irradiance.rgb;
    if (has(4u)) {
        // The transfer knows no normal map: what the map changes without occluders, it changes with them.
        vec3 plain = max(vec3(0.0), open_irradiance(fragment.vertex_normal));
        seen *= clamp(open / max(plain, vec3(1e-12)), vec3(0.0), vec3(4.0));
    }
    out_irradiance = vec4(max(vec3(0.0), seen), clamp(irradiance.a, 0.0, 1.0));
}
