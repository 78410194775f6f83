// Radiance in three mantissas of 9 bits and a common exponent (EXT_texture_shared_exponent).

uint pack_rgb9e5(vec3 radiance) {
    radiance = clamp(radiance, vec3(0.0), vec3(65408.0));
    float largest = max(radiance.r, max(radiance.g, radiance.b));
    // The exponent that leaves the largest channel below 2^9 units; one more where rounding would reach it.
    int exponent = clamp(int(floatBitsToUint(largest) >> 23u) - 126, -15, 16);
    if (int(largest * exp2(float(9 - exponent)) + 0.5) == 512) exponent += 1;
    uvec3 units = uvec3(radiance * exp2(float(9 - exponent)) + 0.5);
    return units.r | units.g << 9u | units.b << 18u | uint(exponent + 15) << 27u;
}

vec3 unpack_rgb9e5(uint bits) {
    // 2^(exponent - 9), from its bits.
    float unit = uintBitsToFloat(((bits >> 27u) + 103u) << 23u);
    return vec3(bits & 511u, (bits >> 9u) & 511u, (bits >> 18u) & 511u) * unit;
}
