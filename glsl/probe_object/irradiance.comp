#version 460
// Irradiance of every vertex: the product of the light's coefficients with those of its transfer (Hajisharif et al. 2012,
// 3.7, Eq. 14). The product is linear in the transfer, so interpolating it over a triangle gives at each fragment what
// the product with interpolated coefficients would.
#extension GL_GOOGLE_include_directive : require
#include "shared/transfer.glsl"
#include "common/harmonics.glsl"

const uint GROUP = 64u;
const uint COUNT = ORDER * ORDER;
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
    uint vertex = gl_GlobalInvocationID.x;
    if (vertex >= transfer.vertices) return;
    vec3 irradiance = vec3(0.0);
    float visible = 0.0;
    for (uint channel = 0u; channel < CHANNELS; ++channel) {
        vec3 sum = vec3(0.0);
        for (uint k = 0u; k < TEXELS; ++k) {
            vec4 part = texelFetch(transfer_texels, int((vertex * CHANNELS + channel) * TEXELS + k));
            sum += part.x * light[4u * k] + part.y * light[4u * k + 1u] + part.z * light[4u * k + 2u]
                 + part.w * light[4u * k + 3u];
            // What a white surround of radiance 1 gives, as a share of pi.
            if (k == 0u) visible += part.x * 1.128379167 / float(CHANNELS);
        }
        if (CHANNELS == 1u) irradiance = sum;
        else irradiance[channel] = sum[channel];
    }
    imageStore(vertex_irradiance_out, int(vertex), vec4(irradiance, visible));
}
