// Radiance of the probe by direction and solid angle, from the levels of its pyramid. Filtered by hand: texels are
// 32-bit floats, which not every device filters, and as many as a buffer holds.
layout(binding = 20) uniform samplerBuffer probe_texels;
layout(std430, binding = 21) readonly buffer ProbeLevels { uvec4 probe_levels[]; }; // width, height, first texel

// Where texels of a row begin, and by how many columns they are shifted: beyond a pole the sphere goes on half a turn away.
ivec2 probe_row(ivec3 level, int row) {
    bool beyond = row < 0 || row >= level.y;
    int inside = row < 0 ? -1 - row : row >= level.y ? 2 * level.y - 1 - row : row;
    return ivec2(level.z + inside * level.x, beyond ? level.x / 2 : 0);
}

vec3 probe_texel(ivec3 level, ivec2 row, int column) {
    column += row.y;
    if (column >= level.x) column -= level.x;
    return texelFetch(probe_texels, row.x + column).rgb;
}

vec3 probe_level(uint index, vec2 uv) {
    ivec3 level = ivec3(probe_levels[index].xyz);
    vec2 place = uv * vec2(level.xy) - 0.5;
    vec2 corner = floor(place);
    vec2 part = place - corner;
    int left = int(corner.x);
    if (left < 0) left += level.x;
    else if (left >= level.x) left -= level.x;
    int right = left + 1 == level.x ? 0 : left + 1;
    ivec2 upper_row = probe_row(level, int(corner.y));
    ivec2 lower_row = probe_row(level, int(corner.y) + 1);
    vec3 upper = mix(probe_texel(level, upper_row, left), probe_texel(level, upper_row, right), part.x);
    vec3 lower = mix(probe_texel(level, lower_row, left), probe_texel(level, lower_row, right), part.x);
    return mix(upper, lower, part.y);
}

// Mean radiance over about the given solid angle, steradians; the finest there is for 0. Of the two levels between which
// it lies the nearer one: whoever takes many samples sees no steps.
vec3 probe_radiance(vec3 direction, float solid_angle) {
    const float pi = 3.14159265358979;
    vec2 uv = vec2(0.5 + atan(direction.x, -direction.z) / (2.0 * pi), acos(clamp(direction.y, -1.0, 1.0)) / pi);
    uvec4 finest = probe_levels[0];
    // Texels shrink towards the poles, but a patch around a pole is not of one texel.
    float across = sqrt(max(1.0 - direction.y * direction.y, solid_angle / pi));
    float texel = 2.0 * pi * pi / float(finest.x * finest.y) * max(across, 1e-6);
    float wanted = 0.5 * log2(max(solid_angle, 1e-12) / texel);
    float most = float(probe_levels.length()) - 1.0;
    return probe_level(uint(clamp(wanted + 0.5, 0.0, most)), uv);
}
