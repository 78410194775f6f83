#version 460
// The light G-buffer of one view of a lamp (Preiner 2010, 4.1): what the point passes made of it, into the atlas of all
// views, and how important each pixel is: the power that its surface reflects.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer surface; // colour, depth
layout(binding = 1) uniform samplerBuffer surface_normals;
layout(binding = 2, rgba32f) uniform writeonly imageBuffer lamp_places_out;  // position, depth or 0
layout(binding = 3, rgba32f) uniform writeonly imageBuffer lamp_normals_out; // normal, power from the lamp over its strength
layout(binding = 4, rgba32f) uniform writeonly imageBuffer lamp_colors_out;
layout(binding = 5, r32f) uniform writeonly imageBuffer importance_out;

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint size = lamp_pass.light_size;
    if (index >= size * size) return;
    ivec2 pixel = ivec2(index & (size - 1u), index >> uint(findMSB(size)));
    LampView view = load_lamp_view(lamp_pass.view);
    vec4 color = texelFetch(surface, int(index));
    color.rgb = min(color.rgb, vec3(1.0));
    vec3 normal = texelFetch(surface_normals, int(index)).xyz;
    vec2 slope = (vec2(pixel) + 0.5 - 0.5 * float(size)) / view.focal;
    float length2 = 1.0 + dot(slope, slope);
    vec3 ray = view.right * slope.x + view.down * slope.y + view.forward;

    // Solid angle of the pixel; for a sun its area across the light.
    float share = inversesqrt(length2) / (length2 * view.focal * view.focal);
    if (view.kind == SUN) share = color.w * color.w / (view.focal * view.focal);
    bool lit = color.w > 0.0 && (view.kind != SPOT || inversesqrt(length2) >= view.cone);
    if (!lit) share = 0.0;

    int texel = lamp_texel(lamp_pass.view, pixel);
    imageStore(lamp_places_out, texel, vec4(view.eye + ray * color.w, color.w));
    imageStore(lamp_normals_out, texel, vec4(normal, share));
    imageStore(lamp_colors_out, texel, color);
    imageStore(importance_out, texel, vec4(share * luminance(view.strength) * reflectance(color.rgb)));
}
