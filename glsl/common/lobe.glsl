// Narrow lobes: a second micro-buffer a pixel, warped to its GGX lobe (not in the paper, which names importance sampling
// as the cure for roughness below 0.2). On the unit disc, every part has the share of the distribution's half vectors
// (Walter et al. 2007, Eqs. 35 and 36) that its area is of the disc's: at the slope s = tan theta_h of a half vector, the
// share nearer to the normal is s^2 / (s^2 + alpha^2).
layout(constant_id = 12) const bool LOBE = false;

// GGX alpha by entry.
layout(binding = 23) uniform samplerBuffer lobe_alphas;

// The disc holds this share of the half vectors; what the tails reflect comes from the pixel's other buffer. In between,
// from the second share on, one fades into the other.
const float LOBE_SHARE = 0.9;
const float LOBE_SURE = 0.7;

struct Lobe {
    vec3 view;
    vec3 mirror;    // direction of the mirror image
    float alpha2;
    float cosine;   // of the half aperture of a cone around `mirror` that holds the lobe
    float sine;
    float view_cosine;
};

// How much of the light by a half vector with the given share comes from the lobe's own buffer.
float lobe_weight(float share) { return clamp((LOBE_SHARE - share) / (LOBE_SHARE - LOBE_SURE), 0.0, 1.0); }

// The same by the cosine of half vector and normal.
float lobe_weight_of(float cosine, float alpha2) {
    float cosine2 = cosine * cosine;
    return lobe_weight((1.0 - cosine2) / (1.0 - cosine2 + alpha2 * cosine2));
}

Lobe load_lobe(vec3 view, vec3 normal, float alpha) {
    Lobe lobe;
    lobe.view = view;
    lobe.view_cosine = dot(view, normal);
    lobe.mirror = 2.0 * lobe.view_cosine * normal - view;
    lobe.alpha2 = max(1e-6, alpha * alpha);
    // Turning a half vector by an angle turns the direction by twice that at most: cos 2a = 2 cos^2 a - 1.
    float slope2 = lobe.alpha2 * LOBE_SHARE / (1.0 - LOBE_SHARE);
    lobe.cosine = 2.0 / (1.0 + slope2) - 1.0;
    lobe.sine = sqrt(max(0.0, 1.0 - lobe.cosine * lobe.cosine));
    return lobe;
}

// Place on the disc of a direction, from the tangent frame of the normal.
vec2 lobe_place(Lobe lobe, vec3 tangent, vec3 bitangent, vec3 normal, vec3 direction) {
    vec3 h = direction + lobe.view;
    vec2 slope = vec2(dot(tangent, h), dot(bitangent, h)) / max(1e-4, dot(normal, h));
    return slope * inversesqrt((dot(slope, slope) + lobe.alpha2) * LOBE_SHARE);
}

// Share of the disc per solid angle at a direction.
float lobe_density(Lobe lobe, vec3 normal, vec3 direction) {
    vec3 h = normalize(direction + lobe.view);
    float c = dot(normal, h);
    float t = 1.0 - (1.0 - lobe.alpha2) * c * c;
    return lobe.alpha2 * c / (3.14159265 * t * t * 4.0 * max(1e-3, dot(direction, h)) * LOBE_SHARE);
}
