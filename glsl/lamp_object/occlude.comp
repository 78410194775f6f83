#version 460
// An object in a lamp's view: it hides what lies behind it, and no light is placed on it.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform sampler2D position_map; // world space, w 1 where the object is
layout(binding = 1) uniform samplerBuffer lamp_places;
layout(binding = 2, rgba32f) uniform writeonly imageBuffer lamp_places_out; // position, depth
layout(binding = 3, r32f) uniform writeonly imageBuffer importance_out;

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint size = lamp_pass.light_size;
    if (index >= size * size) return;
    ivec2 pixel = ivec2(index & (size - 1u), index >> uint(findMSB(size)));
    vec4 place = texelFetch(position_map, pixel, 0);
    if (place.w == 0.0) return;
    LampView view = load_lamp_view(lamp_pass.view);
    float depth = dot(place.xyz - view.eye, view.forward);
    int texel = lamp_texel(lamp_pass.view, pixel);
    float behind = texelFetch(lamp_places, texel).w;
    if (behind > 0.0 && behind <= depth) return;
    imageStore(lamp_places_out, texel, vec4(place.xyz, depth));
    imageStore(importance_out, texel, vec4(0.0));
}
