// What a virtual point light sends to a place on a surface (Preiner 2010, 4.4).
#include "common/vpl.glsl"
#include "common/vpl_visible.glsl"

layout(constant_id = 0) const bool GLOSSY = false; // lights have mirror lobes

// Irradiance of a place from a light, and the direction of that.
vec3 vpl_irradiance(uint index, vec3 position, vec3 normal, out vec3 direction) {
    Vpl light = load_vpl(index);
    vec3 to = position - light.position;
    float distance2 = dot(to, to), distance_ = sqrt(distance2);
    float cosines = dot(to, light.normal) * -dot(to, normal);
    direction = to / distance_;
    if (dot(to, light.normal) <= 0.0 || cosines <= 0.0) return vec3(0.0);
    mat3 frame = frame_of(light.normal);
    if (!vpl_sees(index, to * frame, distance_, normal * frame)) return vec3(0.0);
    vec3 intensity = light.diffuse;
    if (GLOSSY) intensity += glossy_intensity(index, light.normal, direction);
    return intensity * (cosines / (distance2 * (distance2 + near_bound(light))));
}
