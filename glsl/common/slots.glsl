// Even bits of a byte-sized Morton code, packed.
uint even_bits(uint code) {
    code &= 0x55u;
    code = (code | (code >> 1u)) & 0x33u;
    return (code | (code >> 2u)) & 0x0fu;
}

// Place in the image region of a pixel slot.
ivec2 texel_of(uint pixel) {
    uint tile = pixel >> 8u;
    return ivec2(uvec2(tile % gather.tiles_x, tile / gather.tiles_x) * 16u
                 + uvec2(even_bits(pixel), even_bits((pixel & 0xffu) >> 1u)));
}
