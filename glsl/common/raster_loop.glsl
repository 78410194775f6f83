// Hands every node of a pixel's cut to `rasterise`, which the includer defines along with `finish`, called at the end.
//
// Lists: the traversal left lists of nodes for the receivers of all levels, and a pixel's cut is what they hold for the
// receivers above it. Neighbouring invocations read the same lists.
// Walk: the pixel walks the whole hierarchy itself, depth first (classic PBGI: Sabbadin 2019, 5.2, after Ritschel 2009).
//
// A dispatch does a bounded amount of work for each pixel and remembers how far it came: some devices end long loops
// silently (lavapipe after 65,535 turns of all loops of a SIMD group together), others lose patience.
layout(constant_id = 2) const bool WALK = false;

// By entry of the chunk: where to go on, or FINISHED.
layout(std430, binding = 17) buffer Cursors { uint cursors[]; };
layout(std430, binding = 18) buffer RasterCounts {
    uint unfinished_count; // pixels that need another dispatch
    uint reserved;
    uint64_t offered_count; // nodes handed to pixels
    uint64_t drawn_count;   // those of them that cover something
    uint64_t visited_count; // nodes visited by walks
};

const uint FINISHED = 0xffffffffu;
// Turns of loops in one dispatch, for each pixel: eight pixels of a SIMD group stay below the limit above.
const uint MOST_WORK = 8000u;

uint work = 0u;
uint offered = 0u;
uint drawn = 0u;
uint visited = 0u;

void offer(uint start, Site site, uint node, vec3 centre, vec3 area_vector) {
    offered += 1u;
    rasterise(start, site, node, centre, area_vector);
}

// The lists of the pixel, or of the tile alone, from position `cursor` of all of them one after the other; returns where
// to go on.
uint rasterise_lists(uint start, Site site, uint entry, uint cursor) {
    uint position = 0u;
    for (uint level = 0u; level < (SHARED ? 1u : 5u); ++level) {
        uint slot = SHARED ? receiver_slot(gather.pixels, entry)
                           : level_offset(gather.pixels, level) + (entry >> (2u * level));
        uvec2 list = lists[slot];
        uint i = cursor > position ? min(cursor - position, list.y) : 0u;
        for (; i < list.y && work < MOST_WORK; ++i) {
            work += 1u;
            uint node = texelFetch(cut_nodes, int(list.x + i)).x;
            offer(start, site, node, node_sphere(node).xyz, node_area(node).vector);
        }
        position += i;
        if (i < list.y) return position;
    }
    return FINISHED;
}

uint rasterise_walk(uint start, Site site, uint pixel, uint cursor) {
    vec4 ball = receiver_sphere(pixel);
    vec4 normals = receiver_cone(pixel);
    uint end = node_skip(0u);
    uint node = cursor;
    while (node != end && work < MOST_WORK) {
        work += 1u;
        visited += 1u;
        Area area = node_area(node);
        uint action = decide(node, area, 0u, ball, normals, gather.stop_sin2);
        if (action == STOP) offer(start, site, node, node_sphere(node).xyz, area.vector);
        node = action == DESCEND ? node + 1u : area.skip;
    }
    return node == end ? FINISHED : node;
}

void main() {
    uint at = gl_GlobalInvocationID.x;
    if (at >= gather.entry_count) return;
    uint cursor = cursors[at];
    if (cursor == FINISHED) return;
    uint entry = entries[gather.first_entry + at];
    Site site = load_site(entry);
    uint start = at * MICRO_PIXELS;
    cursor = WALK ? rasterise_walk(start, site, entry, cursor) : rasterise_lists(start, site, entry, cursor);
    cursors[at] = cursor;
    if (cursor != FINISHED && gather.last_round != 0u) atomicAdd(unfinished_count, 1u);
    finish();
}
