// A texel of a tile in 64 bits: radiance in three mantissas of 9 bits and a common exponent, and the place in the
// octahedral map that its light comes from, 16 bits a coordinate.

uvec2 pack_texel(vec3 radiance, vec2 place) {
    radiance = clamp(radiance, vec3(0.0), vec3(65408.0));
    float largest = max(radiance.r, max(radiance.g, radiance.b));
    // The exponent that leaves the largest channel below 2^9 units; one more where rounding would reach it.
    int exponent = clamp(int(floatBitsToUint(largest) >> 23u) - 126, -15, 16);
    if (int(largest * exp2(float(9 - exponent)) + 0.5) == 512) exponent += 1;
    uvec3 units = uvec3(radiance * exp2(float(9 - exponent)) + 0.5);
    return uvec2(units.r | units.g << 9u | units.b << 18u | uint(exponent + 15) << 27u, packUnorm2x16(place));
}

vec3 texel_radiance(uint bits) {
    // 2^(exponent - 9), from its bits.
    float unit = uintBitsToFloat(((bits >> 27u) + 103u) << 23u);
    return vec3(bits & 511u, (bits >> 9u) & 511u, (bits >> 18u) & 511u) * unit;
}

vec2 texel_place(uint bits) { return vec2(bits & 65535u, bits >> 16u) * (1.0 / 65535.0); }
