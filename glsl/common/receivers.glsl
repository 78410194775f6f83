// Receivers: G-buffer pixels in Morton order inside 16 x 16 tiles, and their cone mipmap (Sabbadin 2019, 5.2.1). A
// receiver's code holds its level (0 is a pixel, 4 a tile) in the top four bits and its index at that level below;
// children of index i are 4 i to 4 i + 3 one level down. A pair is [node, receiver code].
//
// Technique `shared`: a receiver of level 2 or more is lit as a whole, by one buffer over the full sphere (a tile).
layout(constant_id = 4) const bool SHARED = false;

layout(binding = 5) uniform samplerBuffer receiver_spheres;
layout(binding = 6) uniform samplerBuffer receiver_cones;

const uint RECEIVER_INDEX_MASK = 0x0fffffffu;

uint receiver_level(uint receiver) { return receiver >> 28u; }
uint receiver_index(uint receiver) { return receiver & RECEIVER_INDEX_MASK; }
uint receiver_code(uint level, uint index) { return (level << 28u) | index; }
uint first_child(uint receiver) {
    return receiver_code(receiver_level(receiver) - 1u, receiver_index(receiver) << 2u);
}

// Levels lie one after the other: sum over l < level of pixels / 4^l, written as a closed form.
uint level_offset(uint pixels, uint level) { return (pixels - (pixels >> (2u * level))) / 3u * 4u; }
uint receiver_slot(uint pixels, uint receiver) {
    return level_offset(pixels, receiver_level(receiver)) + receiver_index(receiver);
}

vec4 receiver_sphere(uint slot) { return texelFetch(receiver_spheres, int(slot)); }
vec4 receiver_cone(uint slot) { return texelFetch(receiver_cones, int(slot)); }

// A receiver with no covered pixel has a negative radius.
bool receiver_is_empty(uint slot) { return receiver_sphere(slot).w < 0.0; }
