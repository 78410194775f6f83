// What no node covers: a panorama at infinity, or black without one.
layout(constant_id = 10) const bool FAR_FIELD = true;

layout(binding = 20) uniform sampler2D far_field;

float luminance(vec3 color) { return dot(color, vec3(0.2126, 0.7152, 0.0722)); }

vec3 far_radiance(vec3 direction, float solid_angle) {
    if (!FAR_FIELD) return vec3(0.0);
    const float pi = 3.14159265358979;
    vec2 uv = vec2(0.5 + atan(direction.x, -direction.z) / (2.0 * pi), acos(clamp(direction.y, -1.0, 1.0)) / pi);
    // The level whose texels are about as large as the micro-pixel.
    float texel = pi / float(gather.far_field_height);
    return textureLod(far_field, uv, max(0.0, 0.5 * log2(solid_angle / (texel * texel)))).rgb;
}
