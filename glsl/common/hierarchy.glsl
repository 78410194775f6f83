// The bounding sphere hierarchy as a structure of arrays, depth first: the left child of inner node i is i + 1, its
// right child is node_skip(i + 1); a leaf has node_skip(i) == i + 1 (Sabbadin 2019, 5.1 and 5.4). Read by texel fetches,
// which bring a whole element at once.
layout(binding = 0) uniform samplerBuffer node_spheres; // centre, radius
layout(binding = 1) uniform usamplerBuffer node_cones;
layout(binding = 2) uniform samplerBuffer node_areas; // sum of area times normal, square metres; w: carries the skip
// Sum of luminance times area times normal; w: carries the chromaticity. Where a micro-pixel keeps one node, as in the
// paper: the mean radiance, linear Rec. 709.
layout(binding = 3) uniform samplerBuffer node_radiances;

// Bits that a float carries: bit 30 makes sure that it is a normal number, which devices move as it is, where small
// integers are denormals (passes::float_with).
uint carried(float texel) { return floatBitsToUint(texel) & 0x1fffffffu; }

const uint OPENS = 1u << 28u;

struct Cone {
    vec3 axis;
    float cosine;
};

// Signed 16-bit fractions of 2^15, so that every device decodes the same bits.
Cone node_cone(uint node) {
    uvec2 packed_cone = texelFetch(node_cones, int(node)).xy;
    ivec2 low = ivec2(packed_cone << 16u) >> 16;
    ivec2 high = ivec2(packed_cone) >> 16;
    const float unit = 1.0 / 32768.0;
    return Cone(vec3(float(low.x), float(high.x), float(low.y)) * unit, float(high.y) * unit);
}

vec4 node_sphere(uint node) { return texelFetch(node_spheres, int(node)); }

struct Area {
    vec3 vector;
    uint skip;
    bool opens; // never taken as it is, whatever its size (Hierarchy::opens)
};

Area node_area(uint node) {
    vec4 texel = texelFetch(node_areas, int(node));
    uint bits = carried(texel.w);
    return Area(texel.xyz, bits & (OPENS - 1u), (bits & OPENS) != 0u);
}

uint node_skip(uint node) { return node_area(node).skip; }

// A dot product that every device rounds alike.
float exact_dot(vec3 a, vec3 b) {
    precise float sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}

// The paper's colour: the mean over all points, the same from all sides (Sabbadin 2019, 5.1).
vec3 node_mean(uint node) { return texelFetch(node_radiances, int(node)).rgb; }

// Channels divided by the largest (passes::packed_chromaticity).
vec3 chromaticity(uint bits) {
    vec2 others = vec2(bits & 8191u, (bits >> 13u) & 8191u) / 8191.0;
    uint largest = bits >> 26u;
    if (largest == 0u) return vec3(1.0, others);
    return largest == 1u ? vec3(others.x, 1.0, others.y) : vec3(others, 1.0);
}

// Radiance (linear Rec. 709) that a node sends against `to_node`, a direction of any length. Not the paper's mean over
// all points (Sabbadin 2019, 5.1): of a lamp and its casing in one node, only the side that faces the pixel is seen.
// Seen nearly edge-on, where the areas of both sides cancel, the quotient may come out brighter than any point:
// `brightest`, the largest channel of any, bounds it. A node without area or direction is black.
vec3 node_radiance(uint node, vec3 to_node, vec3 area_vector, float brightest) {
    vec4 texel = texelFetch(node_radiances, int(node));
    precise float facing = exact_dot(area_vector, to_node);
    if (facing == 0.0) return vec3(0.0);
    precise float luminance = max(0.0, exact_dot(texel.xyz, to_node) / facing);
    precise vec3 color = chromaticity(carried(texel.w));
    precise float largest = luminance / exact_dot(color, vec3(0.2126, 0.7152, 0.0722));
    precise vec3 radiance = color * min(largest, brightest);
    return radiance;
}
