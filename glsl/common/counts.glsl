// Counts of a batch; they may run past a capacity, which is how an overflow is found.
layout(std430, binding = 12) buffer Counts {
    uint handed_count;  // pairs that the geometry shader left for the compute pass (hybrid)
    uint cut_count;     // pairs of the cut
    uint visited_count; // pairs that the compute pass looked at
    uint taken;         // pairs that the compute pass has begun, or asked for in vain
    uint placed;        // nodes that have a place in a list; technique `shared`: nodes for the longest list
};
