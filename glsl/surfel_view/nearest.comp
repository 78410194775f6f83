#version 460
// Which point of the front surface lies nearest to the middle of every pixel. The picture's own normals come from
// differences across pixels, which round every edge; a point has its own.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/point_view.glsl"
#include "common/rgb9e5.glsl"
#include "common/surfel.glsl"

layout(local_size_x = 128) in;

layout(binding = 2) uniform samplerBuffer shaded_in; // colour, depth
layout(std430, binding = 3) buffer SurfelKeys { uint64_t surfel_keys[]; };

#include "surfel_view/same_surface.glsl"

void main() {
    if (gl_GlobalInvocationID.x >= point_view.count) return;
    uint index = point_view.first + gl_GlobalInvocationID.x;
    vec3 position = uintBitsToFloat(texelFetch(points, int(index)).xyz);
    vec3 view = view_from_world(position);
    if (!(view.z >= point_view.near)) return;
    vec2 at = view.xy / view.z * point_view.focal + 0.5 * vec2(point_view.width, point_view.height);
    if (any(lessThan(at, vec2(0.0))) || at.x >= float(point_view.width) || at.y >= float(point_view.height)) return;
    uvec2 pixel = uvec2(at);
    uint slot = pixel.y * point_view.width + pixel.x;
    float front = texelFetch(shaded_in, int(slot)).w;
    if (view.z > front + same_surface(front)) return;
    vec2 off = at - vec2(pixel) - 0.5;
    // At an edge the side that is turned away comes last. The number in the cloud decides where two lie alike.
    float turned = dot(load_surfel(int(index)).normal, position - point_view.eye) > 0.0 ? 1.0 : 0.0;
    uint64_t key = uint64_t(floatBitsToUint(dot(off, off) + turned)) << 32 | uint64_t(point_view.source + index);
    if (key < surfel_keys[slot]) atomicMin(surfel_keys[slot], key);
}
