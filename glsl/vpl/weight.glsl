// How much a point would contribute as the next light of a path (Preiner 2010, 4.5): what the present light sends there,
// and how much of that the point reflects.
#include "shared/lamp_pass.glsl"
#include "common/rgb9e5.glsl"
#include "common/lamp_setup.glsl"
#include "common/vpl.glsl"
#include "common/surfel.glsl"

layout(constant_id = 0) const bool GLOSSY = false;

// Sums of weights are integers of this part, so that no order matters.
const float WEIGHT_UNIT = 1.0 / 16777216.0;

struct Candidate {
    vec3 to;        // from the light to the point
    vec3 intensity; // towards it
    float weight;   // share of the light's flux that the point would reflect
    float facing;   // cosine at the point times its area over the squared distance
};

Candidate candidate_of(uint light, Surfel surfel) {
    Vpl from = load_vpl(light);
    Candidate candidate = Candidate(surfel.position - from.position, vec3(0.0), 0.0, 0.0);
    float distance2 = dot(candidate.to, candidate.to);
    float flux = luminance(load_flux(light));
    if (!(distance2 > 0.0) || !(flux > 0.0)) return candidate;
    vec3 direction = candidate.to * inversesqrt(distance2);
    float cosine = dot(from.normal, direction), at_point = -dot(surfel.normal, direction);
    if (cosine <= 0.0 || at_point <= 0.0) return candidate;
    candidate.intensity = from.diffuse;
    if (GLOSSY) candidate.intensity += glossy_intensity(light, from.normal, direction);
    candidate.intensity *= cosine;
    float side = surfel.spacing * lamp_pass.spread;
    candidate.facing = at_point * side * side / (distance2 + near_bound(from));
    candidate.weight = luminance(candidate.intensity) / flux * candidate.facing * reflectance(surfel.color);
    return candidate;
}
