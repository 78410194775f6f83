// A texel of a tile in 64 bits: radiance in three mantissas of 9 bits and a common exponent; where in it the light comes
// from, 8 bits a coordinate; and its inverse distance from the tile's middle as a half float, 0 for the far field.
#include "common/rgb9e5.glsl"

uvec2 pack_texel(vec3 radiance, vec2 middle, float inverse_distance) {
    uvec2 place = uvec2(middle * 255.0 + 0.5);
    return uvec2(pack_rgb9e5(radiance),
                 place.x | place.y << 8u | packHalf2x16(vec2(0.0, min(inverse_distance, 60000.0))));
}

vec3 texel_radiance(uint bits) { return unpack_rgb9e5(bits); }
vec2 texel_middle(uint bits) { return vec2(bits & 255u, (bits >> 8u) & 255u) * (1.0 / 255.0); }
float texel_inverse_distance(uint bits) { return unpackHalf2x16(bits).y; }
