#version 460
// Imperfect shadow maps (Ritschel et al. 2008; Preiner 2010, 4.3): each point goes to one map a round, as a box whose size
// follows from its depth. The paper's boxes grow with the square of the depth; these cover what the point's share of the
// surface does, which shrinks with it. Within a box depths are those of the point's plane, or walls seen from the side
// would shadow themselves.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/rgb9e5.glsl"
#include "common/lamp_setup.glsl"
#include "common/vpl.glsl"
#include "common/light_of.glsl"
#include "common/surfel.glsl"

layout(local_size_x = 128) in;

layout(std430, binding = 2) buffer IsmDepths { uint ism_depths[]; };

// Widest half box, of a map's side.
const float WIDEST = 0.125;
// Radius of the disc that a point stands for, in spacings of the map's points.
const float RADIUS = 0.55;

void main() {
    if (gl_GlobalInvocationID.x >= lamp_pass.count) return;
    uint index = lamp_pass.first + gl_GlobalInvocationID.x;
    uint map = light_of(lamp_pass.base + index);
    Surfel surfel = load_surfel(int(index));
    Vpl light = load_vpl(map);
    vec3 to = surfel.position - light.position;
    float along = dot(to, light.normal);
    float distance_ = length(to);
    // What lies in the light's own plane hides nothing.
    if (!(along > 1e-3 * distance_)) return;
    mat3 frame = frame_of(light.normal);
    vec3 local = to * frame, normal = surfel.normal * frame;
    float side = surfel.spacing * lamp_pass.spread;
    if (distance_ < 0.25 * side) return;

    vec2 middle = paraboloid_place(local / distance_);
    float size = float(lamp_pass.ism_size);
    float reach = min(0.5 * RADIUS * side * size / (distance_ + along), WIDEST * size);
    ivec2 low = max(ivec2(ceil(middle - reach - 0.5)), ivec2(0));
    ivec2 high = min(ivec2(floor(middle + reach - 0.5)), ivec2(lamp_pass.ism_size) - 1);
    if (low.x > high.x) return;
    float height = dot(normal, local);
    int first = ism_texel(map, 0u);
    for (ivec2 at = low; at.y <= high.y;) {
        vec3 direction = paraboloid_direction(vec2(at) + 0.5);
        float planar = height / dot(normal, direction);
        if (planar > 0.0 && distance(direction * planar, local) <= RADIUS * side) {
            uint slot = uint(first + at.y * int(lamp_pass.ism_size) + at.x);
            uint bits = floatBitsToUint(planar);
            if (bits < ism_depths[slot]) atomicMin(ism_depths[slot], bits);
        }
        at = at.x == high.x ? ivec2(low.x, at.y + 1) : ivec2(at.x + 1, at.y);
    }
}
