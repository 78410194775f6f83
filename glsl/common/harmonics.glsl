// Real spherical harmonics as in scene/harmonics.rs: polar axis +Y, azimuth from +Z towards +X, no Condon-Shortley phase.
// Light is a function of at most five bands.
layout(constant_id = 0) const uint ORDER = 4u;

layout(std430, binding = 24) readonly buffer ProbeLight { vec4 probe_light[25]; };

vec3 light_harmonic(uint k) { return probe_light[k].rgb; }

// Irradiance of a surface without occluders (Ramamoorthi and Hanrahan 2001): bands times pi, 2 pi / 3, pi / 4, 0 and
// -pi / 24. The numbers are those times the normalisation of each function.
vec3 open_irradiance(vec3 n) {
    vec3 sum = light_harmonic(0u) * 0.886226925;
    if (ORDER > 1u) {
        sum += light_harmonic(1u) * (1.023326708 * n.x) + light_harmonic(2u) * (1.023326708 * n.y)
             + light_harmonic(3u) * (1.023326708 * n.z);
    }
    float x2 = n.x * n.x, y2 = n.y * n.y, z2 = n.z * n.z;
    if (ORDER > 2u) {
        sum += light_harmonic(4u) * (0.858085531 * n.x * n.z) + light_harmonic(5u) * (0.858085531 * n.x * n.y)
             + light_harmonic(6u) * (0.247707956 * (3.0 * y2 - 1.0)) + light_harmonic(7u) * (0.858085531 * n.y * n.z)
             + light_harmonic(8u) * (0.429042765 * (z2 - x2));
    }
    if (ORDER > 4u) {
        float low = 7.0 * y2 - 1.0;
        sum -= light_harmonic(16u) * (0.327686825 * n.x * n.z * (z2 - x2))
             + light_harmonic(17u) * (0.231709576 * n.y * n.x * (3.0 * z2 - x2))
             + light_harmonic(18u) * (0.123853978 * n.x * n.z * low)
             + light_harmonic(19u) * (0.087577988 * n.x * n.y * (7.0 * y2 - 3.0))
             + light_harmonic(20u) * (0.013847296 * (35.0 * y2 * y2 - 30.0 * y2 + 3.0))
             + light_harmonic(21u) * (0.087577988 * n.z * n.y * (7.0 * y2 - 3.0))
             + light_harmonic(22u) * (0.061926989 * (z2 - x2) * low)
             + light_harmonic(23u) * (0.231709576 * n.y * n.z * (z2 - 3.0 * x2))
             + light_harmonic(24u) * (0.081921706 * (z2 * z2 - 6.0 * x2 * z2 + x2 * x2));
    }
    return sum;
}
