// Reflectance models, for unit vectors above the horizon: cosines with the normal i (light), o (view), with the half
// vector h, and d between light and half vector.
const float PI = 3.14159265358979;

struct Angles {
    float i;
    float o;
    float h;
    float d;
};

Angles angles_of(vec3 normal, vec3 light, vec3 view) {
    vec3 half_vector = normalize(light + view);
    return Angles(dot(normal, light), dot(normal, view), dot(normal, half_vector), dot(light, half_vector));
}

// Walter et al. 2007, Eqs. 33 and 34: the GGX distribution and Smith's masking for it.
float ggx_distribution(float h, float alpha) {
    float alpha2 = alpha * alpha;
    float t = h * h * (alpha2 - 1.0) + 1.0;
    return alpha2 / (PI * t * t);
}

float smith_masking(float c, float alpha) {
    float alpha2 = alpha * alpha;
    return 2.0 * c / (c + sqrt(alpha2 + (1.0 - alpha2) * c * c));
}

// Separable Smith GGX without the Fresnel term: D G / (4 cos i cos o).
float ggx_lobe(Angles a, float alpha) {
    return ggx_distribution(a.h, alpha) * smith_masking(a.i, alpha) * smith_masking(a.o, alpha) / (4.0 * a.i * a.o);
}

float pow5(float x) {
    float x2 = x * x;
    return x2 * x2 * x;
}

// Burley 2012, Physically Based Shading at Disney: base colour, metallic, roughness and specular of the principled
// model. Masking uses alpha = roughness^2 as the distribution does. `lobe_kept` scales the specular term.
vec3 principled(Angles a, vec3 base_color, float metallic, float roughness, float specular, float lobe_kept) {
    float grazing = 0.5 + 2.0 * a.d * a.d * roughness;
    float diffuse = mix(1.0, grazing, pow5(1.0 - a.i)) * mix(1.0, grazing, pow5(1.0 - a.o)) / PI;
    vec3 normal_incidence = mix(vec3(0.08 * specular), base_color, metallic);
    vec3 fresnel = mix(normal_incidence, vec3(1.0), pow5(1.0 - a.d));
    float alpha = max(1e-3, roughness * roughness);
    return base_color * (diffuse * (1.0 - metallic)) + fresnel * (ggx_lobe(a, alpha) * lobe_kept);
}
