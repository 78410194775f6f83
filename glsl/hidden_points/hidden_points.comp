#version 460
// Hidden point removal with the pyramidal, adaptive neighbourhood (Bouchiba et al. 2018, 3.1.2): around the pixel's texel
// at each level up to the one of Eq. 1 the ring of eight, one in each sector.
#extension GL_GOOGLE_include_directive : require
#include "hidden_points/occlusion.glsl"

// Metric size of the neighbourhood, s_hpr = 10 s_0.
const float SIZE = 10.0;
// The level that serves as a coarse depth map.
const uint COARSE = 4u;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    ivec2 pixel = ivec2(index % point_view.width, index / point_view.width);
    bool empty;
    vec3 point = point_or_far(index, empty);

    // Size and first texel of each level in turn.
    ivec2 size = ivec2(point_view.width, point_view.height);
    int first = 0;
    float depth = 0.0;
    for (uint level = 0u; level < point_view.levels && depth == 0.0; ++level) {
        ivec2 at = pixel >> int(level);
        // Where a sparse cloud leaves the coarse map empty, a coarser one serves.
        if (level >= COARSE) depth = texelFetch(point_levels, first + at.y * size.x + at.x).z;
        first += size.x * size.y;
        size = (size + 1) / 2;
    }
    if (depth == 0.0) {
        store_visibility(index, point, empty, true);
        return;
    }
    // Eq. 1. The ring of level l reaches from 2^l to 2^(l + 1) pixels, so the last level is one below.
    float reach = SIZE * point_view.spacing * point_view.focal / depth;
    uint last = min(uint(clamp(floor(log2(reach)) - 1.0, 0.0, 30.0)), point_view.levels - 1u);

    const ivec2 RING[8] = ivec2[8](ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1), ivec2(-1, 0), ivec2(-1, -1),
                                   ivec2(0, -1), ivec2(1, -1));
    vec4 least[2] = vec4[2](vec4(OPEN), vec4(OPEN)); // by sector
    // Sectors that the image's border cuts off do not count.
    bvec4 known[2] = bvec4[2](bvec4(true), bvec4(true));
    size = ivec2(point_view.width, point_view.height);
    first = 0;
    for (uint level = 0u; level <= last; ++level) {
        ivec2 middle = pixel >> int(level);
        for (uint sector = 0u; sector < 8u; ++sector) {
            ivec2 at = middle + RING[sector];
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size));
            at = clamp(at, ivec2(0), size - 1);
            vec3 neighbour = texelFetch(point_levels, first + at.y * size.x + at.x).xyz;
            float value = least[sector >> 2u][sector & 3u];
            bool there = inside && neighbour.z > 0.0;
            if (there) value = min(value, occlusion(point, neighbour));
            least[sector >> 2u][sector & 3u] = value;
            if (there) known[sector >> 2u][sector & 3u] = true;
            else if (!inside && value == OPEN) known[sector >> 2u][sector & 3u] = false;
        }
        first += size.x * size.y;
        size = (size + 1) / 2;
    }
    vec4 weight[2] = vec4[2](vec4(known[0]), vec4(known[1]));
    float sum = dot(least[0], weight[0]) + dot(least[1], weight[1]);
    float count = dot(weight[0] + weight[1], vec4(1.0));
    store_visibility(index, point, empty, sum >= THRESHOLD * count);
}
