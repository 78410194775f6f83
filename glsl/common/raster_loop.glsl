// Hands every node of a pixel's cut to `rasterise`, which the includer defines along with `finish`, called at the end.
//
// Lists: the traversal left lists of nodes for the receivers of all levels, and a pixel's cut is what they hold for the
// receivers above it. Neighbouring invocations read the same lists.
// Walk: the pixel walks the whole hierarchy itself, depth first (classic PBGI: Sabbadin 2019, 5.2, after Ritschel 2009);
// or the part of it that its narrow lobe may reflect.
//
// A dispatch does a bounded amount of work for each pixel and remembers how far it came: some devices end long loops
// silently (lavapipe after 65,535 turns of all loops of a SIMD group together), others lose patience.
layout(constant_id = 2) const bool WALK = false;

// By entry of the chunk: where to go on, or FINISHED.
layout(std430, binding = 21) buffer Cursors { uint cursors[]; };
layout(std430, binding = 22) buffer RasterCounts {
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

// A node as the walk of a pixel's narrow lobe sees it: opened while it is larger than the parts of the lobe's disc that
// it may cover, left out beyond the lobe.
uint decide_lobe(uint node, Area area, vec3 position, vec3 normal, Lobe lobe, float stop_sin2) {
    vec4 sphere = node_sphere(node);
    bool leaf = area.skip == node + 1u;
    vec3 to_node = sphere.xyz - position;
    float distance2 = dot(to_node, to_node);
    float height = dot(normal, to_node);
    float facing = dot(area.vector, to_node);
    if (height + sphere.w < 0.0) return DISCARD;
    if (distance2 <= sphere.w * sphere.w) return leaf ? (height > 0.0 && facing < 0.0 ? STOP : DISCARD) : DESCEND;
    float inverse = inversesqrt(distance2);
    // Angles: t of the node's middle from the mirror direction, r of its radius, a of the lobe.
    float t_cosine = dot(to_node, lobe.mirror) * inverse;
    float t_sine = sqrt(max(0.0, 1.0 - t_cosine * t_cosine));
    float r_sine = sphere.w * inverse;
    float r_cosine = sqrt(1.0 - r_sine * r_sine);
    // t > a + r, where that is less than half a turn.
    float reach = lobe.cosine * r_cosine - lobe.sine * r_sine;
    if (lobe.sine * r_cosine + lobe.cosine * r_sine > 0.0 && t_cosine < reach) return DISCARD;
    Cone cone = node_cone(node);
    float along_cone = dot(to_node, cone.axis);
    float cone_sine = sqrt(max(0.0, 1.0 - cone.cosine * cone.cosine));
    float least = along_cone * cone.cosine - sqrt(max(0.0, distance2 - along_cone * along_cone)) * cone_sine;
    if (!leaf && cone.cosine > 0.0 && least > sphere.w * (1.0 + 1e-3)) return DISCARD;
    // The distribution at the nearest part of the node, t - r from the mirror direction, half of that in half vectors.
    float near_cosine = t_cosine >= r_cosine ? 1.0 : t_cosine * r_cosine + t_sine * r_sine;
    float h_cosine2 = 0.5 + 0.5 * near_cosine;
    float spread = 1.0 - (1.0 - lobe.alpha2) * h_cosine2;
    // (radius / distance)^2 of a node with the solid angle that stops, from the density of the disc: 8 / pi * share *
    // (o . h) * spread^2 / alpha^2, in the units of `stop_sin2`, which are for micro-pixels of a hemisphere. Three times
    // that costs half and is hardly worse.
    float bound = stop_sin2 * 8.0 * LOBE_SHARE * max(0.25, lobe.view_cosine) * spread * spread / lobe.alpha2;
    bool stops = !area.opens && (leaf || r_sine * r_sine <= min(bound, 0.1));
    if (stops) return height > 0.0 && facing < 0.0 ? STOP : DISCARD;
    return DESCEND;
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
        uint action = LOBE ? decide_lobe(node, area, site.position, site.normal, site.lobe, gather.stop_sin2)
                           : decide(node, area, 0u, ball, normals, gather.stop_sin2);
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
    Site site = load_site(entry, gather.first_entry + at);
    uint start = at * MICRO_PIXELS;
    cursor = WALK ? rasterise_walk(start, site, entry, cursor) : rasterise_lists(start, site, entry, cursor);
    cursors[at] = cursor;
    if (cursor != FINISHED && gather.last_round != 0u) atomicAdd(unfinished_count, 1u);
    finish();
}
