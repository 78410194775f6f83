#version 460
// From a level to the next finer one: what has less than its whole weight is filled from the four coarser samples around.
#extension GL_GOOGLE_include_directive : require
#include "pull_push/combine.glsl"

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.level_width * point_view.level_height) return;
    int slot = int(point_view.target + index);
    float weight = texelFetch(filled, slot).w;
    // The background stays.
    if (weight >= 1.0 || weight < 0.0) return;
    ivec2 coarser = (ivec2(point_view.level_width, point_view.level_height) + 1) / 2;
    ivec2 pixel = ivec2(index % point_view.level_width, index / point_view.level_width);
    ivec2 middle = pixel / 2;
    ivec2 side = ivec2((pixel.x & 1) == 0 ? -1 : 1, (pixel.y & 1) == 0 ? -1 : 1);
    Sample samples[4];
    for (int k = 0; k < 4; ++k) {
        ivec2 at = clamp(middle + side * ivec2(k & 1, k >> 1), ivec2(0), coarser - 1);
        samples[k] = load_sample(int(point_view.source) + at.y * coarser.x + at.x);
    }
    Sample result = combine(samples, vec4(9.0, 3.0, 3.0, 1.0) / 16.0);
    if (result.position.w <= 0.0) return;
    if (weight > 0.0) {
        Sample own = load_sample(slot);
        bool same = same_surface(own.position.z, result.position.z);
        float kept = same ? weight : 1.0;
        result.position.xyz = mix(result.position.xyz, own.position.xyz, kept);
        result.color = mix(result.color, own.color, kept);
    }
    result.position.w = 1.0;
    store_sample(slot, result);
}
