// Weighted means of positions and colours that keep surfaces apart (pull-push after Kraus 2009; the front surface alone
// takes part in a mean, as in Marroquim et al. 2008, or depths between two surfaces would come out that are on neither).
#include "shared/point_view.glsl"
#include "common/rgb9e5.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer filled; // position in view space and weight; weight -1 is the background
layout(binding = 1) uniform usamplerBuffer filled_colors;
layout(binding = 2, rgba32f) uniform writeonly imageBuffer filled_out;
layout(binding = 3, r32ui) uniform writeonly uimageBuffer filled_colors_out;

// Depths within this share of the nearest belong to one surface.
const float SAME_SURFACE = 0.05;

struct Sample {
    vec4 position; // and weight
    vec3 color;
};

Sample load_sample(int index) {
    return Sample(texelFetch(filled, index), unpack_rgb9e5(texelFetch(filled_colors, index).x));
}

bool same_surface(float a, float b) { return abs(a - b) <= SAME_SURFACE * min(a, b); }

// Mean of the front surface among four samples; its weight is the sum of theirs, at most 1.
Sample combine(Sample samples[4], vec4 shares) {
    float front = 1e30;
    for (uint k = 0u; k < 4u; ++k) {
        if (samples[k].position.w > 0.0) front = min(front, samples[k].position.z);
    }
    Sample sum = Sample(vec4(0.0), vec3(0.0));
    for (uint k = 0u; k < 4u; ++k) {
        vec4 position = samples[k].position;
        float weight = position.w > 0.0 && position.z <= front * (1.0 + SAME_SURFACE) ? position.w * shares[k] : 0.0;
        sum.position += vec4(position.xyz * weight, weight);
        sum.color += samples[k].color * weight;
    }
    if (sum.position.w > 0.0) {
        sum.color /= sum.position.w;
        sum.position.xyz /= sum.position.w;
    }
    sum.position.w = min(1.0, sum.position.w);
    return sum;
}

void store_sample(int index, Sample result) {
    imageStore(filled_out, index, result.position);
    imageStore(filled_colors_out, index, uvec4(pack_rgb9e5(result.color)));
}
