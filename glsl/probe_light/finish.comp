#version 460
// The second reduction of a probe's projection, a workgroup for each basis function; then the window against ringing and
// the temporal filter (Hajisharif et al. 2012, 3.5 and 3.6, Eq. 13).
#extension GL_GOOGLE_include_directive : require
#include "shared/probe.glsl"

layout(constant_id = 0) const uint ORDER = 4u;
const uint GROUP = 64u;
const uint COUNT = ORDER * ORDER;
layout(local_size_x = GROUP) in;

layout(std430, binding = 4) buffer ProbePartials { vec4 probe_partials[]; };
layout(binding = 5) uniform samplerBuffer probe_window; // weight of each function
layout(std430, binding = 24) buffer ProbeLight { vec4 probe_light[25]; };

shared vec3 sums[GROUP];

void main() {
    uint k = gl_WorkGroupID.x;
    uint own = gl_LocalInvocationIndex;
    vec3 sum = vec3(0.0);
    for (uint group = own; group < probe.groups; group += GROUP) sum += probe_partials[group * COUNT + k].rgb;
    sums[own] = sum;
    for (uint stride = GROUP / 2u; stride > 0u; stride /= 2u) {
        barrier();
        if (own < stride) sums[own] += sums[own + stride];
    }
    if (own == 0u) {
        vec3 light = sums[0] * texelFetch(probe_window, int(k)).x;
        probe_light[k] = vec4((light + probe.keep * probe_light[k].rgb) / (1.0 + probe.keep), 0.0);
    }
}
