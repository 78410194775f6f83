// Level 0 of the point pyramid (Bouchiba et al. 2018, 3.1.1): positions in view space; z is 0 where there is no point.
#include "shared/point_view.glsl"

layout(local_size_x = 256) in;

layout(binding = 2, rgba32f) uniform writeonly imageBuffer point_levels_out;
layout(binding = 3, r32ui) uniform writeonly uimageBuffer point_colors_out;

// `depth` is near / z, 0 for none.
void store_point(uint index, float depth, uint color) {
    vec2 pixel = vec2(index % point_view.width, index / point_view.width) + 0.5;
    vec3 position = depth > 0.0 ? pixel_ray(pixel) * (point_view.near / depth) : vec3(0.0);
    imageStore(point_levels_out, int(index), vec4(position, 0.0));
    imageStore(point_colors_out, int(index), uvec4(color));
}
