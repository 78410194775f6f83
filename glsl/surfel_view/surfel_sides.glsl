// On which sides of a pixel's middle the front surface lies: 16 sectors of points that face the eye, then 16 of those that
// do not. Splats are too large at silhouettes; a surface covers the middle only if it lies on all sides of it.

// Pixels that no silhouette crosses.
const uint ALL_SIDES = 0xffffffffu;
// Sectors without points that make a silhouette: half a circle, less what points leave open by chance.
const uint HALF = 7u;

uint side_of(vec2 off, bool turned) {
    float angle = atan(off.y, off.x) * (8.0 / 3.14159265) + 8.0;
    return 1u << (min(uint(angle), 15u) + (turned ? 16u : 0u));
}

bool covers_middle(uint sides) {
    uint facing = sides & 0xffffu;
    uint taken = facing != 0u ? facing : sides >> 16u;
    if (taken == 0u) return true;
    uint open = ~(taken | taken << 16u);
    open &= open >> 1u;
    open &= open >> 2u;
    open &= open >> (HALF - 4u);
    return (open & 0xffffu) == 0u;
}
