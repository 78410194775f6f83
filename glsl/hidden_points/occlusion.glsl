// What the operators of hidden point removal share (Bouchiba et al. 2018, 3.1.2; Pintus et al. 2011).
#include "shared/point_view.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer point_levels;
layout(binding = 1, rgba32f) uniform writeonly imageBuffer filled_out;

// Mean occlusion below which a point is hidden and a pixel without one is a hole.
const float THRESHOLD = 0.1;
// What a sector with nothing in front of the far plane has.
const float OPEN = 2.0;
// Depth of what has no point, in spacings.
const float FAR = 1e6;

// Occlusion value of `point` by its neighbour, both in view space: 0 right in front of it, 1 beside it, 2 behind it.
float occlusion(vec3 point, vec3 neighbour) {
    vec3 to = neighbour - point;
    // The length of `to` may underflow to 0 where the two coincide; such a neighbour hides nothing.
    float lengths = sqrt(dot(to, to) * dot(neighbour, neighbour));
    return lengths > 0.0 ? 1.0 + dot(to, neighbour) / lengths : OPEN;
}

// The pixel's point, or a place on the far plane.
vec3 point_or_far(uint index, out bool empty) {
    vec3 point = texelFetch(point_levels, int(index)).xyz;
    empty = point.z == 0.0;
    vec2 pixel = vec2(index % point_view.width, index / point_view.width) + 0.5;
    return empty ? pixel_ray(pixel) * (FAR * point_view.spacing) : point;
}

// Position and weight for pull-push: weight 1 for a visible point, 0 for a hole, -1 for the background.
void store_visibility(uint index, vec3 point, bool empty, bool visible) {
    imageStore(filled_out, int(index), empty || !visible ? vec4(0.0, 0.0, 0.0, visible ? -1.0 : 0.0) : vec4(point, 1.0));
}
