#version 460
// Normals of a level of the filled surface, by the cross product of the differences to its neighbours (Bouchiba et al.
// 2018, 3.3).
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer filled;
layout(binding = 1, r32ui) uniform writeonly uimageBuffer point_normals_out; // x and y in view space; z is negative

ivec2 size;

vec4 sample_at(ivec2 at) {
    bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size));
    at = clamp(at, ivec2(0), size - 1);
    vec4 value = texelFetch(filled, int(point_view.target) + at.y * size.x + at.x);
    return inside ? value : vec4(0.0);
}

// Across the pixel where the surface goes on at both sides; else to the side that is nearer in depth.
vec3 difference(vec4 before, vec4 here, vec4 after) {
    float back = before.w > 0.0 ? abs(here.z - before.z) : 1e30;
    float ahead = after.w > 0.0 ? abs(after.z - here.z) : 1e30;
    if (min(back, ahead) >= 1e30) return vec3(0.0);
    if (max(back, ahead) <= 2.0 * min(back, ahead) + 0.01 * here.z) return after.xyz - before.xyz;
    return back < ahead ? here.xyz - before.xyz : after.xyz - here.xyz;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    size = ivec2(point_view.level_width, point_view.level_height);
    if (index >= uint(size.x * size.y)) return;
    ivec2 at = ivec2(index % uint(size.x), index / uint(size.x));
    vec4 here = sample_at(at);
    vec3 along_x = difference(sample_at(at - ivec2(1, 0)), here, sample_at(at + ivec2(1, 0)));
    vec3 along_y = difference(sample_at(at - ivec2(0, 1)), here, sample_at(at + ivec2(0, 1)));
    vec3 normal = cross(along_x, along_y);
    float size2 = dot(normal, normal);
    // Towards the eye where there is no telling.
    normal = size2 > 0.0 ? normal * inversesqrt(size2) : vec3(0.0, 0.0, -1.0);
    if (dot(normal, here.xyz) > 0.0) normal = -normal;
    // Away from the image's middle a surface that is seen may still have a normal with z above 0: its place on the
    // octahedron tells.
    vec2 place = normal.xy / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    if (normal.z > 0.0) {
        place = (1.0 - abs(place.yx)) * vec2(place.x < 0.0 ? -1.0 : 1.0, place.y < 0.0 ? -1.0 : 1.0);
    }
    imageStore(point_normals_out, int(point_view.target + index), uvec4(packSnorm2x16(place)));
}
