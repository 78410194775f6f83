// Hands every node of an entry's lists to `rasterise`, which the includer defines, once for each of its pixels. A block's
// lists are those of the receivers that contain all of it (levels 4 to 1; each node is fetched once for all pixels),
// then those of each pixel alone. The includer also defines `finish`, called once at the end.
void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= gather.entry_count) return;
    uint entry = entries[gather.first_entry + at];
    uint block = PIXELS == 1u ? entry : entry >> 4u;
    Site sites[PIXELS];
    [[unroll]] for (uint k = 0u; k < PIXELS; ++k) {
        sites[k] = load_site(block * PIXELS + k, PIXELS == 1u || (entry & (1u << k)) != 0u);
    }
    const uint shared_levels = PIXELS == 1u ? 5u : 4u;
    const uint steps = PIXELS == 1u ? 5u : 8u;
    for (uint step = 0u; step < steps; ++step) {
        bool alone = step >= shared_levels;
        uint level = alone ? 0u : 4u - step;
        uint own = step - shared_levels;
        uint pixel = block * PIXELS + (alone ? own : 0u);
        uvec2 list = lists[level_offset(gather.pixels, level) + (pixel >> (2u * level))];
        for (uint i = 0u; i < list.y; ++i) {
            uint node = texelFetch(cut_nodes, int(list.x + i)).x;
            vec3 centre = node_sphere(node).xyz;
            vec3 area_vector = node_area(node).vector;
            float area2 = dot(area_vector, area_vector);
            [[unroll]] for (uint k = 0u; k < PIXELS; ++k) {
                if (!alone || own == k) {
                    uint start = microbuffer_start(at, k);
                    rasterise(start, sites[k], node, centre, area_vector, area2);
                }
            }
        }
    }
    finish();
}
