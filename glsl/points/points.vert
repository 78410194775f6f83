#version 460
// One pixel a point (Bouchiba et al. 2018, section 3).
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in uint color;
layout(location = 0) flat out uint color_out; // RGB9E5

void main() {
    vec3 view = view_from_world(position);
    // Depth near / z: 1 at the near plane, 0 infinitely far, with the precision of a float everywhere.
    vec2 side = 2.0 * point_view.focal / vec2(point_view.width, point_view.height);
    gl_Position = vec4(view.xy * side, point_view.near, view.z);
    gl_PointSize = 1.0;
    color_out = color;
}
