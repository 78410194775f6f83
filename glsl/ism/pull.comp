#version 460
// From a level of all maps to the next coarser one.
#extension GL_GOOGLE_include_directive : require
#include "ism/fill.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint size = lamp_pass.ism_size >> lamp_pass.level;
    uint bits = 2u * uint(findMSB(size));
    uint map = index >> bits;
    if (map >= lamp_pass.vpls) return;
    uint texel = index & ((1u << bits) - 1u);
    int corner = int(2u * (texel >> (bits / 2u)) * 2u * size + 2u * (texel & (size - 1u)));
    int at = ism_texel(map, lamp_pass.level - 1u) + corner;
    int row = int(2u * size);
    uint depths[4] = uint[4](texelFetch(ism, at).x, texelFetch(ism, at + 1).x, texelFetch(ism, at + row).x,
                             texelFetch(ism, at + row + 1).x);
    imageStore(ism_out, ism_texel(map, lamp_pass.level) + int(texel), uvec4(surface_mean(depths, vec4(0.25))));
}
