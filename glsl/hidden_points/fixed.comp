#version 460
// Hidden point removal with all pixels of a disc of fixed radius as the neighbourhood (Pintus et al. 2011): what the
// paper's Table 1 compares with.
#extension GL_GOOGLE_include_directive : require
#include "hidden_points/occlusion.glsl"

layout(constant_id = 0) const int RADIUS = 15;

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    ivec2 pixel = ivec2(index % point_view.width, index / point_view.width);
    bool empty;
    vec3 point = point_or_far(index, empty);
    float least[8] = float[8](OPEN, OPEN, OPEN, OPEN, OPEN, OPEN, OPEN, OPEN); // by sector
    for (int y = -RADIUS; y <= RADIUS; ++y) {
        for (int x = -RADIUS; x <= RADIUS; ++x) {
            ivec2 at = pixel + ivec2(x, y);
            if (x * x + y * y > RADIUS * RADIUS || (x == 0 && y == 0) || any(lessThan(at, ivec2(0)))
                || at.x >= int(point_view.width) || at.y >= int(point_view.height)) continue;
            vec3 neighbour = texelFetch(point_levels, at.y * int(point_view.width) + at.x).xyz;
            if (neighbour.z == 0.0) continue;
            // Eighths of a turn, the first around +x; 5 / 12 is the tangent of half of one to half a per cent.
            ivec2 size = abs(ivec2(x, y));
            int sector = 12 * size.y < 5 * size.x ? 0 : 12 * size.x < 5 * size.y ? 2 : 1;
            if (x < 0) sector = 4 - sector;
            if (y < 0) sector = (8 - sector) & 7;
            least[sector] = min(least[sector], occlusion(point, neighbour));
        }
    }
    float sum = 0.0;
    for (uint sector = 0u; sector < 8u; ++sector) sum += least[sector];
    store_visibility(index, point, empty, sum >= 8.0 * THRESHOLD);
}
