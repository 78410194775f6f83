// Radiance of the probe by direction and solid angle, from the levels of its pyramid. Filtered by hand: texels are
// 32-bit floats, which not every device filters, and as many as a buffer holds.
layout(binding = 20) uniform samplerBuffer probe_texels;
layout(std430, binding = 21) readonly buffer ProbeLevels { uvec4 probe_levels[]; }; // width, height, first texel

vec3 probe_texel(uvec4 level, ivec2 at) {
    ivec2 size = ivec2(level.xy);
    // Beyond a pole the sphere goes on half a turn away.
    if (at.y < 0 || at.y >= size.y) at = ivec2(at.x + size.x / 2, at.y < 0 ? -1 - at.y : 2 * size.y - 1 - at.y);
    int column = at.x % size.x;
    if (column < 0) column += size.x;
    return texelFetch(probe_texels, int(level.z) + at.y * size.x + column).rgb;
}

vec3 probe_level(uint index, vec2 uv) {
    uvec4 level = probe_levels[index];
    vec2 place = uv * vec2(level.xy) - 0.5;
    vec2 corner = floor(place);
    vec2 part = place - corner;
    ivec2 at = ivec2(corner);
    vec3 upper = mix(probe_texel(level, at), probe_texel(level, at + ivec2(1, 0)), part.x);
    vec3 lower = mix(probe_texel(level, at + ivec2(0, 1)), probe_texel(level, at + ivec2(1, 1)), part.x);
    return mix(upper, lower, part.y);
}

// Mean radiance over about the given solid angle, steradians; the finest there is for 0.
vec3 probe_radiance(vec3 direction, float solid_angle) {
    const float pi = 3.14159265358979;
    vec2 uv = vec2(0.5 + atan(direction.x, -direction.z) / (2.0 * pi), acos(clamp(direction.y, -1.0, 1.0)) / pi);
    uvec4 finest = probe_levels[0];
    // Texels shrink towards the poles, but a patch around a pole is not of one texel.
    float across = sqrt(max(1.0 - direction.y * direction.y, solid_angle / pi));
    float texel = 2.0 * pi * pi / float(finest.x * finest.y) * max(across, 1e-6);
    float wanted = 0.5 * log2(max(solid_angle, 1e-12) / texel);
    float most = float(probe_levels.length()) - 1.0;
    float level = clamp(wanted, 0.0, most);
    uint lower = min(uint(level), uint(most));
    vec3 fine = probe_level(lower, uv);
    float part = level - float(lower);
    return part > 0.0 ? mix(fine, probe_level(lower + 1u, uv), part) : fine;
}
