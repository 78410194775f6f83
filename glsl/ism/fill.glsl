// Pull and push on shadow maps (Preiner 2010, 4.3): means of one surface among four.
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"
#include "common/vpl.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform usamplerBuffer ism;
layout(binding = 1, r32ui) uniform writeonly uimageBuffer ism_out;

// Depths within this share of the nearest belong to one surface.
const float SAME_SURFACE = 0.25;

// The mean of the surface at the front or of what is behind it, whichever has the larger share: always the front would
// make every occluder larger.
uint surface_mean(uint depths[4], vec4 shares) {
    uint nearest = min(min(depths[0], depths[1]), min(depths[2], depths[3]));
    if (nearest == OPEN) return OPEN;
    float most = uintBitsToFloat(nearest) * (1.0 + SAME_SURFACE);
    vec2 front = vec2(0.0), behind = vec2(0.0);
    for (uint k = 0u; k < 4u; ++k) {
        float depth = uintBitsToFloat(depths[k]);
        if (depths[k] == OPEN) continue;
        vec2 part = vec2(depth, 1.0) * shares[k];
        if (depth <= most) front += part;
        else behind += part;
    }
    return floatBitsToUint(front.y >= behind.y ? front.x / front.y : behind.x / behind.y);
}
