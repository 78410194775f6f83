// The bounding sphere hierarchy as a structure of arrays, depth first: the left child of inner node i is i + 1, its
// right child is node_skips[i + 1]; a leaf has node_skips[i] == i + 1 (Sabbadin 2019, 5.1 and 5.4).
layout(std430, binding = 0) readonly buffer NodeSpheres { vec4 node_spheres[]; };
layout(std430, binding = 1) readonly buffer NodeCones { uvec2 node_cones[]; };
layout(std430, binding = 2) readonly buffer NodeSkips { uint node_skips[]; };
// Three floats a node: sum of area times normal, square metres.
layout(std430, binding = 3) readonly buffer NodeAreaVectors { float node_area_vectors[]; };
// Three floats a node: linear Rec. 709 radiance.
layout(std430, binding = 4) readonly buffer NodeColors { float node_colors[]; };

struct Cone {
    vec3 axis;
    float cosine;
};

// Signed 16-bit fractions of 2^15, so that every device decodes the same bits.
Cone node_cone(uint node) {
    uvec2 packed_cone = node_cones[node];
    ivec2 low = ivec2(packed_cone << 16u) >> 16;
    ivec2 high = ivec2(packed_cone) >> 16;
    const float unit = 1.0 / 32768.0;
    return Cone(vec3(float(low.x), float(high.x), float(low.y)) * unit, float(high.y) * unit);
}

vec3 node_area_vector(uint node) {
    return vec3(node_area_vectors[3u * node], node_area_vectors[3u * node + 1u], node_area_vectors[3u * node + 2u]);
}

vec3 node_color(uint node) {
    return vec3(node_colors[3u * node], node_colors[3u * node + 1u], node_colors[3u * node + 2u]);
}

// A dot product that every device rounds alike.
float exact_dot(vec3 a, vec3 b) {
    precise float sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}
