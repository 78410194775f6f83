#version 460
// Which point of the front surface lies nearest to the middle of every pixel. The picture's own normals come from
// differences across pixels, which round every edge; a point has its own. Where a silhouette may cross a pixel, also on
// which sides of the middle the front surface lies, and which point is nearest on the surface behind.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "shared/point_view.glsl"
#include "common/rgb9e5.glsl"
#include "common/surfel.glsl"

layout(local_size_x = 128) in;

layout(binding = 2) uniform samplerBuffer shaded_in; // colour, depth
layout(std430, binding = 3) buffer SurfelKeys { uint64_t surfel_keys[]; }; // front, behind
layout(std430, binding = 4) buffer SurfelSides { uint surfel_sides[]; }; // of all pixels, then the edges

#include "surfel_view/same_surface.glsl"
#include "surfel_view/surfel_sides.glsl"

// How far from the middle of a pixel points tell about it: in spacings, and at least and at most in pixels.
const float REACH = 2.0;
const float LEAST = 1.0;
const float MOST = 4.0;
// Farther than any of them.
const float TURNED = 64.0;

void take(uint key, uint high, uint number) {
    uint64_t entry = uint64_t(high) << 32 | uint64_t(number);
    if (entry < surfel_keys[key]) atomicMin(surfel_keys[key], entry);
}

void main() {
    if (gl_GlobalInvocationID.x >= point_view.count) return;
    uint index = point_view.first + gl_GlobalInvocationID.x;
    vec3 position = uintBitsToFloat(texelFetch(points, int(index)).xyz);
    vec3 view = view_from_world(position);
    if (!(view.z >= point_view.near)) return;
    vec2 size = vec2(point_view.width, point_view.height);
    vec2 at = view.xy / view.z * point_view.focal + 0.5 * size;
    if (any(lessThan(at, vec2(-MOST))) || any(greaterThan(at, size + MOST))) return;
    Surfel surfel = load_surfel(int(index));
    float spacing = surfel.spacing * point_view.focal / view.z;
    float reach = clamp(REACH * spacing, LEAST, MOST);
    bool turned = dot(surfel.normal, position - point_view.eye) > 0.0;
    uint number = point_view.source + index;
    ivec2 own = ivec2(floor(at));
    ivec2 low = max(ivec2(ceil(at - reach - 0.5)), ivec2(0));
    ivec2 high = min(ivec2(floor(at + reach - 0.5)), ivec2(size) - 1);
    if (low.x > high.x) return;
    for (ivec2 pixel = low; pixel.y <= high.y;) {
        uint slot = uint(pixel.y) * point_view.width + uint(pixel.x);
        // The sides themselves fill up as points come in, in whatever order that is.
        bool edge = surfel_sides[point_view.width * point_view.height + slot] != 0u;
        vec2 off = at - vec2(pixel) - 0.5;
        float distance2 = dot(off, off);
        if (pixel == own || edge && distance2 <= reach * reach) {
            float front = texelFetch(shaded_in, int(slot)).w;
            if (view.z <= front + same_surface(front)) {
                // At an edge the side that is turned away comes last. The number in the cloud decides where two lie alike.
                take(2u * slot, floatBitsToUint(distance2 + (turned ? TURNED : 0.0)), number);
                // Points that are few here leave gaps that are no silhouette.
                if (edge) atomicOr(surfel_sides[slot], REACH * spacing > MOST ? ALL_SIDES : side_of(off, turned));
            } else if (edge && !turned) {
                // By depth first, in steps of a thousandth. What is turned away there is the back of what is before it.
                uint near = uint(min(distance2 * 256.0, 8191.0));
                take(2u * slot + 1u, floatBitsToUint(view.z) & ~8191u | near, number);
            }
        }
        pixel = pixel.x == high.x ? ivec2(low.x, pixel.y + 1) : ivec2(pixel.x + 1, pixel.y);
    }
}
