#version 460
// One pixel a point by atomics on depth and colour (Schuetz et al. 2021, Rendering Point Clouds with Compute Shaders and
// Vertex Order Optimization).
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/point_view.glsl"

layout(local_size_x = 128) in;

layout(binding = 0) uniform usamplerBuffer points; // position as float bits, colour in RGB9E5
layout(std430, binding = 1) buffer PointKeys { uint64_t point_keys[]; };

void main() {
    if (gl_GlobalInvocationID.x >= point_view.count) return;
    uvec4 point = texelFetch(points, int(point_view.first + gl_GlobalInvocationID.x));
    vec3 view = view_from_world(uintBitsToFloat(point.xyz));
    if (!(view.z >= point_view.near)) return;
    vec2 at = view.xy / view.z * point_view.focal + 0.5 * vec2(point_view.width, point_view.height);
    if (any(lessThan(at, vec2(0.0))) || at.x >= float(point_view.width) || at.y >= float(point_view.height)) return;
    uvec2 pixel = uvec2(at);
    // Nearer is larger, as in the depth image of the other path; bits of positive floats order as they do.
    uint64_t key = uint64_t(floatBitsToUint(point_view.near / view.z)) << 32 | uint64_t(point.w);
    uint slot = pixel.y * point_view.width + pixel.x;
    // Most points lie behind what is there already: a plain read, which may be out of date, spares most atomics.
    if (key > point_keys[slot]) atomicMax(point_keys[slot], key);
}
