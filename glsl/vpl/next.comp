#version 460
// The lights of the next bounce, from the candidate that stayed for each (Preiner 2010, 4.5). Its flux is the present
// light's towards it over the chance that it was taken, so that paths keep their energy in the mean.
#extension GL_GOOGLE_include_directive : require
#include "vpl/weight.glsl"
#include "vpl/store.glsl"

layout(local_size_x = 64) in;

layout(binding = 2) uniform usamplerBuffer vpl_taken; // number of the point, key
layout(binding = 3) uniform usamplerBuffer vpl_sums;

void main() {
    uint light = gl_GlobalInvocationID.x;
    if (light >= lamp_pass.vpls) return;
    uvec2 taken = texelFetch(vpl_taken, int(light)).xy;
    uint index = taken.x - lamp_pass.base;
    if (taken.y == 0u) {
        store_vpl(light, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), vec3(0.0), NOTHING);
        return;
    }
    // Another buffer's points.
    if (taken.x < lamp_pass.base || index >= lamp_pass.count) return;
    Surfel surfel = load_surfel(int(index));
    Candidate candidate = candidate_of(light, surfel);
    float sum = float(texelFetch(vpl_sums, int(light)).x) * WEIGHT_UNIT;
    Arriving arriving = NOTHING;
    if (candidate.weight > 0.0) {
        arriving.flux = candidate.intensity * (candidate.facing * sum / candidate.weight);
        arriving.towards = -normalize(candidate.to);
    }
    store_vpl(light, surfel.position, light_area(), surfel.normal, surfel.color, arriving);
}
