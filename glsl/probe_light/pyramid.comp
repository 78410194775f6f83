#version 460
// A level of a probe's pyramid, half as large (Hajisharif et al. 2012, 3.4): a binomial kernel, 1 3 3 1 along each side,
// which is a Gaussian's nearest kin of that width. Its tent shape shares every texel out among those below it wholly,
// so that no lamp gains or loses between levels, and rows weigh by their solid angle.
#extension GL_GOOGLE_include_directive : require
#include "shared/probe.glsl"

layout(local_size_x = 64) in;

layout(binding = 0) uniform samplerBuffer probe_texels;
layout(binding = 1, rgba32f) uniform writeonly imageBuffer probe_texels_out;

float row_solid_angle(int row) {
    const float pi = 3.14159265358979;
    return sin(pi * (float(row) + 0.5) / float(probe.height));
}

// A column up to a width beyond the edges; quicker than a division.
int wrapped(int column, int width) {
    return column < 0 ? column + width : column >= width ? column - width : column;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= probe.target_width * probe.target_height) return;
    ivec2 size = ivec2(probe.width, probe.height);
    // Half the kernel's width, texels of the level that is read: two, or a little more where a side is odd.
    vec2 reach = vec2(size) / vec2(probe.target_width, probe.target_height);
    vec2 centre = (vec2(index % probe.target_width, index / probe.target_width) + 0.5) * reach - 0.5;
    ivec2 low = ivec2(ceil(centre - reach));
    ivec2 high = ivec2(floor(centre + reach));
    vec3 sum = vec3(0.0);
    float weights = 0.0;
    for (int y = low.y; y <= high.y; ++y) {
        bool beyond = y < 0 || y >= size.y;
        int row = y < 0 ? -1 - y : y >= size.y ? 2 * size.y - 1 - y : y;
        float along = (1.0 - abs(float(y) - centre.y) / reach.y) * row_solid_angle(row);
        for (int x = low.x; x <= high.x; ++x) {
            int column = wrapped(x + (beyond ? size.x / 2 : 0), size.x);
            float weight = (1.0 - abs(float(x) - centre.x) / reach.x) * along;
            sum += weight * texelFetch(probe_texels, int(probe.first) + row * size.x + column).rgb;
            weights += weight;
        }
    }
    imageStore(probe_texels_out, int(probe.target_first + index), vec4(sum / weights, 1.0));
}
