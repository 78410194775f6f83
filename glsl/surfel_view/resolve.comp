#version 460
// A G-buffer with the normals of points (Preiner 2010, 4.1), and the depth at the middle of the pixel on the point's plane:
// the nearest of many points in a pixel always lies a little before it. Where a pixel has no point of its own, the
// filled surface stays.
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"
#include "common/rgb9e5.glsl"
#include "common/surfel.glsl"

layout(local_size_x = 64) in;

layout(binding = 2) uniform samplerBuffer shaded_in; // colour, depth
layout(binding = 3) uniform samplerBuffer shaded_normals_in;
layout(binding = 4) uniform usamplerBuffer surfel_taken; // number of the point, key; at the front and behind
layout(binding = 5, rgba32f) uniform writeonly imageBuffer surface_out;
layout(binding = 6, rgba32f) uniform writeonly imageBuffer surface_normals_out;
layout(binding = 7) uniform usamplerBuffer surfel_sides_in;

const uint NONE = 0xffffffffu;
#include "surfel_view/same_surface.glsl"
#include "surfel_view/surfel_sides.glsl"
// Planes seen more edge-on than this cosine tell no depth.
const float EDGE_ON = 0.05;

bool beside_nothing(ivec2 at) {
    ivec2 last = ivec2(point_view.width, point_view.height) - 1;
    for (int k = 0; k < 9; ++k) {
        ivec2 beside = clamp(at + ivec2(k % 3, k / 3) - 1, ivec2(0), last);
        if (texelFetch(shaded_in, beside.y * int(point_view.width) + beside.x).w == 0.0) return true;
    }
    return false;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    uvec2 taken = texelFetch(surfel_taken, 2 * int(index)).xy;
    vec4 surface = texelFetch(shaded_in, int(index));
    vec4 normal = texelFetch(shaded_normals_in, int(index));
    if (!covers_middle(texelFetch(surfel_sides_in, int(index)).x)) {
        uvec2 behind = texelFetch(surfel_taken, 2 * int(index) + 1).xy;
        if (behind.y != NONE) taken = behind;
        else if (beside_nothing(ivec2(index % point_view.width, index / point_view.width))) {
            taken.y = NONE;
            surface = vec4(0.0);
            normal = vec4(0.0);
        }
    }
    if (taken.y == NONE || surface.w == 0.0) {
        imageStore(surface_out, int(index), surface);
        imageStore(surface_normals_out, int(index), normal);
        return;
    }
    // Another buffer's points.
    uint number = taken.x - point_view.source;
    if (taken.x < point_view.source || number >= point_view.count) return;
    Surfel surfel = load_surfel(int(number));
    vec3 place = view_from_world(surfel.position);
    vec3 facing = vec3(dot(surfel.normal, point_view.right), dot(surfel.normal, point_view.down),
                       dot(surfel.normal, point_view.forward));
    vec3 ray = pixel_ray(vec2(index % point_view.width, index / point_view.width) + 0.5);
    float towards = dot(facing, ray);
    float planar = dot(facing, place) / towards;
    bool known = abs(towards) > EDGE_ON * length(ray) && abs(planar - place.z) <= same_surface(place.z);
    // What is seen from behind is lit from behind.
    vec3 side = dot(facing, place) > 0.0 ? -surfel.normal : surfel.normal;
    imageStore(surface_out, int(index), vec4(surfel.color, known ? planar : place.z));
    imageStore(surface_normals_out, int(index), vec4(side, 1.0));
}
