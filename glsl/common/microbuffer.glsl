// Micro-buffers (Sabbadin 2019, 5.2, after Ritschel 2009): SIZE x SIZE micro-pixels over the unit disc, onto which the
// hemisphere above a pixel is projected orthogonally, so that every micro-pixel has the same projected solid angle.
layout(constant_id = 3) const uint SIZE = 24u;

// Pixels of the batch, as receiver indices.
layout(std430, binding = 7) readonly buffer Entries { uint entries[]; };
layout(std430, binding = 8) readonly buffer Lists { uvec2 lists[]; };
layout(binding = 9) uniform usamplerBuffer cut_nodes;

const uint MICRO_PIXELS = SIZE * SIZE;

// Tangent frame of a normal (Duff et al. 2017, Building an Orthonormal Basis, Revisited).
void tangent_frame(vec3 n, out vec3 t, out vec3 b) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float c = n.x * n.y * a;
    t = vec3(1.0 + s * n.x * n.x * a, s * c, -s * n.x);
    b = vec3(c, s + n.y * n.y * a, -n.y);
}

// A pixel as the raster passes see it.
struct Site {
    vec3 position;
    vec3 normal;
    vec3 tangent;
    vec3 bitangent;
};

Site load_site(uint pixel) {
    Site site;
    site.position = receiver_sphere(pixel).xyz;
    site.normal = receiver_cone(pixel).xyz;
    tangent_frame(site.normal, site.tangent, site.bitangent);
    return site;
}

// What a node covers of a pixel's micro-buffer: a box of even density around the projection of its centre, in
// micro-pixels, with the extent of the node's area seen from the pixel and its exact projected solid angle.
struct Footprint {
    vec2 low;
    vec2 high;
    float density; // covered share of a micro-pixel inside the box; 0 where nothing is covered
    float depth;   // distance to the node's centre, metres
};

Footprint footprint_of(Site site, vec3 centre, vec3 area_vector) {
    Footprint footprint;
    footprint.density = 0.0;
    footprint.low = footprint.high = vec2(0.0);
    footprint.depth = 0.0;
    precise vec3 to_node = centre - site.position;
    precise float height = exact_dot(site.normal, to_node);
    precise float facing = exact_dot(area_vector, to_node);
    if (height <= 0.0 || facing >= 0.0) return footprint;
    precise float distance2 = exact_dot(to_node, to_node);
    precise float inverse = inversesqrt(distance2);
    precise float inverse_area = inversesqrt(dot(area_vector, area_vector));
    precise float depth = distance2 * inverse;
    precise vec2 at = vec2(dot(site.tangent, to_node), dot(site.bitangent, to_node)) * inverse;
    // The solid angle of a patch: area * cosine / distance^2 at its centre, times what its mean over a disc of that area
    // differs by to second order, 1 + (9 - 15 cos^2) area / (8 pi distance^2): less where the rim is farther away, more
    // at grazing angles. Bounded for patches so near that they would be touched.
    precise float tilt = facing * inverse * inverse_area;
    precise float flat_angle = -facing * inverse * inverse * inverse;
    precise float curvature = (9.0 - 15.0 * tilt * tilt) * inverse * inverse / inverse_area * 0.039788736;
    precise float solid_angle = curvature < 0.0 ? flat_angle / (1.0 - curvature) : flat_angle * min(1.0 + curvature, 1.25);
    precise float cosine = height * inverse;
    // Variance of the patch projected onto the disc, per axis: the gradient of the projection, less its part along
    // the patch's normal m. `tilt` is m . direction.
    precise vec2 m = vec2(dot(site.tangent, area_vector), dot(site.bitangent, area_vector)) * inverse_area;
    precise vec2 lean = m - tilt * at;
    precise vec2 variance = max(vec2(1e-4), 1.0 - at * at - lean * lean);
    precise float side = 0.5 * inverse / sqrt(inverse_area);
    const float to_micro = 0.5 * float(SIZE);
    // Nodes larger than a micro-pixel overlap by up to a half, or coverage would be uneven where single points show.
    precise float blur = clamp(0.5 + side * to_micro, 1.0, 1.5);
    precise vec2 extent = max(vec2(0.01), blur * side * sqrt(variance) * to_micro);
    precise vec2 middle = at * to_micro + to_micro;
    footprint.low = middle - extent;
    footprint.high = middle + extent;
    footprint.depth = depth;
    precise float covered = solid_angle * cosine * (to_micro * to_micro);
    footprint.density = min(1.0, covered / (4.0 * extent.x * extent.y));
    return footprint;
}
