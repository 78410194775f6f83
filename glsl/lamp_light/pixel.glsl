// The camera's G-buffer (Preiner 2010, 4.1): what the point passes made of its view.
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"

layout(binding = 0) uniform samplerBuffer surface; // colour, depth along the view or 0
layout(binding = 1) uniform samplerBuffer surface_normals;

struct Pixel {
    vec3 position;
    float depth; // 0 where nothing is
    vec3 normal;
    vec3 color;
    vec3 to_eye;
};

Pixel load_pixel(ivec2 at) {
    int index = at.y * int(lamp_pass.width) + at.x;
    vec4 color = texelFetch(surface, index);
    vec2 slope = (vec2(at) + 0.5 - 0.5 * vec2(lamp_pass.width, lamp_pass.height)) / lamp_pass.focal;
    vec3 ray = lamp_pass.right * slope.x + lamp_pass.down * slope.y + lamp_pass.forward;
    return Pixel(lamp_pass.eye + ray * color.w, color.w, texelFetch(surface_normals, index).xyz,
                 min(color.rgb, vec3(1.0)), -normalize(ray));
}
