// Micro-buffers (Sabbadin 2019, 5.2, after Ritschel 2009): SIZE x SIZE micro-pixels over the unit disc, onto which the
// hemisphere above a pixel is projected orthogonally, so that every micro-pixel has the same projected solid angle.
//
// Technique `shared`: SIZE x SIZE texels over the full sphere around the middle of a tile, in world space, all of the
// same solid angle.
#include "common/lobe.glsl"
#include "common/octahedral.glsl"
#include "common/view.glsl"

layout(constant_id = 3) const uint SIZE = 24u;

// Pixels of the batch, as receiver indices; tiles, as receiver codes.
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

// A pixel, or the middle of a tile, as the raster passes see it.
struct Site {
    vec3 position;
    vec3 normal;
    vec3 tangent;
    vec3 bitangent;
    Lobe lobe; // only of narrow lobes
};

Site load_site(uint entry, uint index) {
    Site site;
    uint slot = SHARED ? receiver_slot(gather.pixels, entry) : entry;
    site.position = receiver_sphere(slot).xyz;
    site.normal = receiver_cone(slot).xyz;
    tangent_frame(site.normal, site.tangent, site.bitangent);
    if (LOBE) {
        float alpha = texelFetch(lobe_alphas, int(index)).x;
        site.lobe = load_lobe(view_of(site.position, site.normal), site.normal, alpha);
    }
    return site;
}

// Cell of a micro-buffer that starts at `start`.
int cell_at(uint start, ivec2 cell) {
    if (SHARED) cell = octahedral_cell(cell, int(SIZE));
    return int(start) + cell.y * int(SIZE) + cell.x;
}

// A place in cells, kept where cells are: from 0 to `most`, or anywhere on the full sphere.
ivec2 kept(vec2 place, float most) {
    return ivec2(SHARED ? floor(place) : clamp(place, vec2(0.0), vec2(most)));
}

// What a node covers of a pixel's micro-buffer: a box of even density around the projection of its centre, in
// micro-pixels, with the extent of the node's area seen from the pixel and its exact projected solid angle.
struct Footprint {
    vec2 low;
    vec2 high;
    float density; // covered share of a micro-pixel inside the box; 0 where nothing is covered
    float depth;   // distance to the node's centre, metres
};

// A footprint on the disc of a lobe: by the places of the patch's half axes.
Footprint lobe_footprint(Site site, vec3 direction, vec3 narrow, vec3 wide, float solid_angle) {
    Footprint footprint;
    const float to_micro = 0.5 * float(SIZE);
    vec2 middle = lobe_place(site.lobe, site.tangent, site.bitangent, site.normal, direction);
    vec2 along = lobe_place(site.lobe, site.tangent, site.bitangent, site.normal, normalize(direction + narrow)) - middle;
    vec2 across = lobe_place(site.lobe, site.tangent, site.bitangent, site.normal, normalize(direction + wide)) - middle;
    vec2 extent = sqrt(along * along + across * across) * to_micro;
    float blur = clamp(0.5 + max(extent.x, extent.y), 1.0, 1.5);
    extent = max(vec2(0.01), blur * extent);
    middle = middle * to_micro + to_micro;
    footprint.low = middle - extent;
    footprint.high = middle + extent;
    float covered = solid_angle * lobe_density(site.lobe, site.normal, direction) * (3.14159265 * to_micro * to_micro);
    footprint.density = min(1.0, covered / (4.0 * extent.x * extent.y));
    // Beyond the rim it covers nothing.
    if (any(greaterThan(footprint.low, vec2(float(SIZE)))) || any(lessThan(footprint.high, vec2(0.0)))) {
        footprint.density = 0.0;
    }
    return footprint;
}

Footprint footprint_of(Site site, vec3 centre, vec3 area_vector) {
    Footprint footprint;
    footprint.density = 0.0;
    footprint.low = footprint.high = vec2(0.0);
    footprint.depth = 0.0;
    precise vec3 to_node = centre - site.position;
    precise float height = exact_dot(site.normal, to_node);
    precise float facing = exact_dot(area_vector, to_node);
    if ((!SHARED && height <= 0.0) || facing >= 0.0) return footprint;
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
    precise float half_side = 0.5 * inverse / sqrt(inverse_area);
    if (SHARED || LOBE) {
        // The patch seen from the site is an ellipse, foreshortened along its lean.
        precise vec3 direction = to_node * inverse;
        vec3 lean = area_vector * inverse_area - tilt * direction;
        lean = dot(lean, lean) > 1e-6 ? normalize(lean) : site.tangent;
        precise vec3 narrow = lean * (half_side * abs(tilt));
        precise vec3 wide = cross(direction, lean) * half_side;
        if (LOBE) {
            footprint = lobe_footprint(site, direction, narrow, wide, solid_angle);
            footprint.depth = depth;
            return footprint;
        }
        vec2 reach;
        precise vec2 middle = octahedral_place(direction, narrow, wide, reach) * float(SIZE);
        precise vec2 extent = reach * float(SIZE);
        // As below: boxes larger than a texel overlap.
        precise float blur = clamp(0.5 + max(extent.x, extent.y), 1.0, 1.5);
        extent = clamp(blur * extent, vec2(0.01), vec2(0.5 * float(SIZE) - 1.0));
        footprint.low = middle - extent;
        footprint.high = middle + extent;
        footprint.depth = depth;
        precise float covered = solid_angle * (float(MICRO_PIXELS) / 12.566370614);
        footprint.density = min(1.0, covered / (4.0 * extent.x * extent.y));
        return footprint;
    }
    precise float cosine = height * inverse;
    // Variance of the patch projected onto the disc, per axis: the gradient of the projection, less its part along
    // the patch's normal m. `tilt` is m . direction.
    precise vec2 m = vec2(dot(site.tangent, area_vector), dot(site.bitangent, area_vector)) * inverse_area;
    precise vec2 lean = m - tilt * at;
    precise vec2 variance = max(vec2(1e-4), 1.0 - at * at - lean * lean);
    const float to_micro = 0.5 * float(SIZE);
    // Nodes larger than a micro-pixel overlap by up to a half, or coverage would be uneven where single points show.
    precise float blur = clamp(0.5 + half_side * to_micro, 1.0, 1.5);
    precise vec2 extent = max(vec2(0.01), blur * half_side * sqrt(variance) * to_micro);
    precise vec2 middle = at * to_micro + to_micro;
    footprint.low = middle - extent;
    footprint.high = middle + extent;
    footprint.depth = depth;
    precise float covered = solid_angle * cosine * (to_micro * to_micro);
    footprint.density = min(1.0, covered / (4.0 * extent.x * extent.y));
    return footprint;
}
