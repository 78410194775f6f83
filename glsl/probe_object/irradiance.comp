#version 460
// Irradiance of every vertex: the product of the light's coefficients with those of its transfer (Hajisharif et al. 2012,
// 3.7, Eq. 14). The product is linear in the transfer, so interpolating it over a triangle gives at each fragment what
// the product with interpolated coefficients would.
#extension GL_GOOGLE_include_directive : require
#include "shared/transfer.glsl"
#include "common/harmonics.glsl"

const uint GROUP = 64u;
const uint COUNT = ORDER * ORDER;
const uint VERTICES = 4u;
const uint TEXELS = (COUNT + 3u) / 4u; // of a channel of a vertex, the last one filled up with zeros
layout(local_size_x = GROUP) in;

layout(constant_id = 1) const uint CHANNELS = 1u;
layout(binding = 0) uniform samplerBuffer transfer_texels;
layout(binding = 1) uniform samplerBuffer object_rotation; // row by row, the light in the object's own axes from that in the world's
layout(binding = 2, rgba32f) uniform writeonly imageBuffer vertex_irradiance_out;

shared vec3 light[4u * TEXELS];

void main() {
    uint own = gl_LocalInvocationIndex;
    if (own < 4u * TEXELS) {
        vec3 sum = vec3(0.0);
        for (uint k = 0u; own < COUNT && k < COUNT; ++k) {
            sum += texelFetch(object_rotation, int(own * 25u + k)).x * light_harmonic(k);
        }
        light[own] = sum;
    }
    barrier();
    // A few vertices each, so that what is read of the light serves all of them.
    uint first = gl_GlobalInvocationID.x;
    vec3 irradiance[VERTICES];
    float visible[VERTICES];
    for (uint v = 0u; v < VERTICES; ++v) {
        irradiance[v] = vec3(0.0);
        visible[v] = 0.0;
    }
    for (uint channel = 0u; channel < CHANNELS; ++channel) {
        vec3 picks = CHANNELS == 1u ? vec3(1.0) : vec3(channel == 0u, channel == 1u, channel == 2u);
        for (uint k = 0u; k < TEXELS; ++k) {
            vec3 a = light[4u * k] * picks, b = light[4u * k + 1u] * picks;
            vec3 c = light[4u * k + 2u] * picks, d = light[4u * k + 3u] * picks;
            for (uint v = 0u; v < VERTICES; ++v) {
                uint vertex = min(first + v * transfer.invocations, transfer.vertices - 1u);
                vec4 part = texelFetch(transfer_texels, int((vertex * CHANNELS + channel) * TEXELS + k));
                irradiance[v] += part.x * a + part.y * b + part.z * c + part.w * d;
                // What a white surround of radiance 1 gives, as a share of pi.
                if (k == 0u) visible[v] += part.x * (1.128379167 / float(CHANNELS));
            }
        }
    }
    for (uint v = 0u; v < VERTICES; ++v) {
        uint vertex = first + v * transfer.invocations;
        if (first < transfer.invocations && vertex < transfer.vertices) {
            imageStore(vertex_irradiance_out, int(vertex), vec4(irradiance[v], visible[v]));
        }
    }
}
