#version 460
// Partial sums of a probe's projection to spherical harmonics (Hajisharif et al. 2012, 3.5, Eq. 12, Figures 1 and 2), with
// the exact solid angle of every row. The paper has a thread for each pixel; here one adds up many rows of its column
// before it shares a sum, and takes them in pairs, north and south: functions of latitude are even or odd. Longitude's
// part of every function is the same all along a column and multiplied in the end.
#extension GL_GOOGLE_include_directive : require
#include "shared/probe.glsl"

layout(constant_id = 0) const uint ORDER = 4u;
const uint GROUP_BITS = 5u;
const uint GROUP = 1u << GROUP_BITS;
const uint COUNT = ORDER * ORDER;
layout(local_size_x = GROUP) in;

layout(binding = 0) uniform samplerBuffer probe_texels;
layout(binding = 2) uniform samplerBuffer probe_rows;    // by row of the northern half: cosine, sine, solid angle
layout(binding = 3) uniform samplerBuffer probe_columns; // sine and cosine of the azimuth
layout(std430, binding = 4) buffer ProbePartials { vec4 probe_partials[]; };

shared vec3 sums[COUNT * GROUP];

void put(uint k, vec3 value) { sums[k * GROUP + gl_LocalInvocationIndex] = value; }

void main() {
    uint across = (probe.width + GROUP - 1u) / GROUP;
    uint column = (gl_WorkGroupID.x % across) * GROUP + gl_LocalInvocationIndex;
    uint half_height = (probe.height + 1u) / 2u;
    uint from = (gl_WorkGroupID.x / across) * probe.rows;
    uint to = min(from + probe.rows, half_height);
    bool inside = column < probe.width;

    // By band and degree, K left out.
    vec3 a00 = vec3(0.0), a10 = vec3(0.0), a11 = vec3(0.0), a20 = vec3(0.0), a21 = vec3(0.0), a22 = vec3(0.0);
    vec3 a30 = vec3(0.0), a31 = vec3(0.0), a32 = vec3(0.0), a33 = vec3(0.0);
    vec3 a40 = vec3(0.0), a41 = vec3(0.0), a42 = vec3(0.0), a43 = vec3(0.0), a44 = vec3(0.0);
    if (inside) {
        for (uint row = from; row < to; ++row) {
            uint other = probe.height - 1u - row;
            vec3 north = texelFetch(probe_texels, int(probe.first + row * probe.width + column)).rgb;
            vec3 south = texelFetch(probe_texels, int(probe.first + other * probe.width + column)).rgb;
            vec4 place = texelFetch(probe_rows, int(row));
            float c = place.x, s = place.y, c2 = c * c;
            vec3 even = (north + south) * place.z;
            vec3 odd = (north - south) * place.z;
            a00 += even;
            if (ORDER > 1u) {
                a10 += odd * c;
                a11 += even * s;
            }
            if (ORDER > 2u) {
                a20 += even * (3.0 * c2 - 1.0);
                a21 += odd * (c * s);
                a22 += even * (s * s);
            }
            if (ORDER > 3u) {
                a30 += odd * (c * (5.0 * c2 - 3.0));
                a31 += even * (s * (5.0 * c2 - 1.0));
                a32 += odd * (c * s * s);
                a33 += even * (s * s * s);
            }
            if (ORDER > 4u) {
                a40 += even * (c2 * (35.0 * c2 - 30.0) + 3.0);
                a41 += odd * (c * s * (7.0 * c2 - 3.0));
                a42 += even * (s * s * (7.0 * c2 - 1.0));
                a43 += odd * (c * s * s * s);
                a44 += even * (s * s * s * s);
            }
        }
    }

    // Longitude, and K.
    vec2 azimuth = texelFetch(probe_columns, int(min(column, probe.width - 1u))).xy; // sine, cosine
    vec2 one = azimuth;
    vec2 two = vec2(2.0 * one.x * one.y, one.y * one.y - one.x * one.x);
    vec2 three = vec2(two.x * one.y + two.y * one.x, two.y * one.y - two.x * one.x);
    vec2 four = vec2(2.0 * two.x * two.y, two.y * two.y - two.x * two.x);
    put(0u, a00 * 0.282094792);
    if (ORDER > 1u) {
        put(1u, a11 * (0.488602512 * one.x));
        put(2u, a10 * 0.488602512);
        put(3u, a11 * (0.488602512 * one.y));
    }
    if (ORDER > 2u) {
        put(4u, a22 * (0.546274215 * two.x));
        put(5u, a21 * (1.092548431 * one.x));
        put(6u, a20 * 0.315391565);
        put(7u, a21 * (1.092548431 * one.y));
        put(8u, a22 * (0.546274215 * two.y));
    }
    if (ORDER > 3u) {
        put(9u, a33 * (0.590043590 * three.x));
        put(10u, a32 * (1.445305721 * two.x));
        put(11u, a31 * (0.457045799 * one.x));
        put(12u, a30 * 0.373176333);
        put(13u, a31 * (0.457045799 * one.y));
        put(14u, a32 * (1.445305721 * two.y));
        put(15u, a33 * (0.590043590 * three.y));
    }
    if (ORDER > 4u) {
        put(16u, a44 * (0.625835735 * four.x));
        put(17u, a43 * (1.770130769 * three.x));
        put(18u, a42 * (0.473087348 * two.x));
        put(19u, a41 * (0.669046544 * one.x));
        put(20u, a40 * 0.105785547);
        put(21u, a41 * (0.669046544 * one.y));
        put(22u, a42 * (0.473087348 * two.y));
        put(23u, a43 * (1.770130769 * three.y));
        put(24u, a44 * (0.625835735 * four.y));
    }

    // Halved until one sum of each function is left, all functions at once.
    for (uint bits = GROUP_BITS; bits > 0u;) {
        --bits;
        barrier();
        for (uint at = gl_LocalInvocationIndex; at < COUNT << bits; at += GROUP) {
            uint slot = (at >> bits) * GROUP + (at & ((1u << bits) - 1u));
            sums[slot] += sums[slot + (1u << bits)];
        }
    }
    barrier();
    if (gl_LocalInvocationIndex < COUNT) {
        uint k = gl_LocalInvocationIndex;
        probe_partials[gl_WorkGroupID.x * COUNT + k] = vec4(sums[k * GROUP], 0.0);
    }
}
