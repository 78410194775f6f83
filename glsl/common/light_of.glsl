// Which light a point of the cloud serves in a round over all points (Preiner 2010, 4.3): lights take turns along the
// Morton curve, so that each gets points that are spread over the whole cloud as evenly as a hash never does it, and
// invocations side by side mostly share a light.

// Points of a chunk (`CHUNK` in preprocess/point_chunks.rs).
const uint CHUNK = 0x10000u;

// Rank along the Morton curve of the point `index` of a chunk of `count`, where points lie in the order of their rank's
// reversed bits: first all even ranks, and so on in each half.
uint rank_in_chunk(uint index, uint count) {
    if (count == CHUNK) return bitfieldReverse(index) >> 16u;
    uint rank = 0u;
    for (uint bit = 1u; count > 1u; bit <<= 1u) {
        uint even = (count + 1u) / 2u;
        bool odd = index >= even;
        if (odd) {
            index -= even;
            rank |= bit;
        }
        count = odd ? count - even : even;
    }
    return rank;
}

uint light_of(uint number) {
    uint first = number & ~(CHUNK - 1u);
    uint rank = rank_in_chunk(number - first, min(CHUNK, lamp_pass.points - first));
    return (first + rank + lamp_pass.offset) % lamp_pass.vpls;
}
