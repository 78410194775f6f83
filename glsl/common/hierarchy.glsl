// The bounding sphere hierarchy as a structure of arrays, depth first: the left child of inner node i is i + 1, its
// right child is node_skip(i + 1); a leaf has node_skip(i) == i + 1 (Sabbadin 2019, 5.1 and 5.4). Read by texel fetches,
// which bring a whole element at once.
layout(binding = 0) uniform samplerBuffer node_spheres; // centre, radius
layout(binding = 1) uniform usamplerBuffer node_cones;
layout(binding = 2) uniform samplerBuffer node_areas; // sum of area times normal, square metres; w: bits of the skip
layout(binding = 3) uniform samplerBuffer node_colors; // linear Rec. 709 radiance

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
};

Area node_area(uint node) {
    vec4 texel = texelFetch(node_areas, int(node));
    return Area(texel.xyz, floatBitsToUint(texel.w));
}

uint node_skip(uint node) { return node_area(node).skip; }

vec3 node_color(uint node) { return texelFetch(node_colors, int(node)).rgb; }

// A dot product that every device rounds alike.
float exact_dot(vec3 a, vec3 b) {
    precise float sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}
