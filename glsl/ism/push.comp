#version 460
// From a level of all maps to the next finer one: holes get what the coarser texels around them have.
#extension GL_GOOGLE_include_directive : require
#include "ism/fill.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint size = lamp_pass.ism_size >> lamp_pass.level;
    uint bits = 2u * uint(findMSB(size));
    uint map = index >> bits;
    if (map >= lamp_pass.vpls) return;
    int texel = int(index & ((1u << bits) - 1u));
    int own = ism_texel(map, lamp_pass.level) + texel;
    if (texelFetch(ism, own).x != OPEN) return;
    ivec2 pixel = ivec2(texel & int(size - 1u), texel >> (bits / 2u));
    ivec2 middle = pixel / 2, side = 2 * (pixel & 1) - 1;
    int coarser = int(size / 2u), first = ism_texel(map, lamp_pass.level + 1u);
    uint depths[4];
    for (int k = 0; k < 4; ++k) {
        ivec2 at = clamp(middle + side * ivec2(k & 1, k >> 1), ivec2(0), ivec2(coarser - 1));
        depths[k] = texelFetch(ism, first + at.y * coarser + at.x).x;
    }
    imageStore(ism_out, own, uvec4(surface_mean(depths, vec4(9.0, 3.0, 3.0, 1.0) / 16.0)));
}
