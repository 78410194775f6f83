// A texel of a tile in 64 bits: radiance in three mantissas of 9 bits and a common exponent; where in it the light comes
// from, 8 bits a coordinate; and its inverse distance from the tile's middle as a half float, 0 for the far field.

uvec2 pack_texel(vec3 radiance, vec2 middle, float inverse_distance) {
    radiance = clamp(radiance, vec3(0.0), vec3(65408.0));
    float largest = max(radiance.r, max(radiance.g, radiance.b));
    // The exponent that leaves the largest channel below 2^9 units; one more where rounding would reach it.
    int exponent = clamp(int(floatBitsToUint(largest) >> 23u) - 126, -15, 16);
    if (int(largest * exp2(float(9 - exponent)) + 0.5) == 512) exponent += 1;
    uvec3 units = uvec3(radiance * exp2(float(9 - exponent)) + 0.5);
    uvec2 place = uvec2(middle * 255.0 + 0.5);
    return uvec2(units.r | units.g << 9u | units.b << 18u | uint(exponent + 15) << 27u,
                 place.x | place.y << 8u | packHalf2x16(vec2(0.0, min(inverse_distance, 60000.0))));
}

vec3 texel_radiance(uint bits) {
    // 2^(exponent - 9), from its bits.
    float unit = uintBitsToFloat(((bits >> 27u) + 103u) << 23u);
    return vec3(bits & 511u, (bits >> 9u) & 511u, (bits >> 18u) & 511u) * unit;
}

vec2 texel_middle(uint bits) { return vec2(bits & 255u, (bits >> 8u) & 255u) * (1.0 / 255.0); }
float texel_inverse_distance(uint bits) { return unpackHalf2x16(bits).y; }
