// What becomes of a pair. All decisions on single pixels use only additions, multiplications and comparisons marked
// `precise`, so that every device, and the CPU reference, takes the same one to the bit. Decisions for a receiver of
// many pixels are conservative: they hold for every pixel below or are not taken, which makes the cut of every pixel
// the same whichever technique finds it (correction of Sabbadin 2019, 5.2.1, whose flat coarse receivers have no
// extent and a cone of zero).

const uint DISCARD = 0u; // no pixel below sees anything of the node
const uint STOP = 1u;    // every pixel below takes the node as it is
const uint DESCEND = 2u; // every pixel below wants the node's children
const uint SPLIT = 3u;   // the pixels below do not agree

// Inner nodes are only discarded when the test holds with this much to spare, relative to the distance: a rounding
// error must not discard a parent of a node that the exact test would keep.
const float SLACK = 1e-3;

// Receivers up to this level are not divided only because some pixels below see a node edge-on or at their horizon.
const uint UNDIVIDED = 2u;

// The paper's own refinement rule and tests (`--paper cut`).
layout(constant_id = 0) const bool PAPER_CUT = false;
// The paper's coverage also shows nodes whose centre lies below the horizon (`--paper coverage`).
layout(constant_id = 1) const bool PAPER_COVERAGE = false;

// Whether a pixel takes a node: its solid angle is at most the threshold T (Sabbadin 2019, Eq. 4), which is
// r^2 <= d^2 (1 - (1 - T / 2 pi)^2) without a root, or it has no children.
bool pixel_stops(float distance2, float radius, float stop_sin2, bool leaf) {
    precise float radius2 = radius * radius;
    precise float bound2 = stop_sin2 * distance2;
    return leaf || radius2 <= bound2;
}

// True when no point of the sphere is above the pixel's horizon (Sabbadin 2019, Eq. 8 with a single normal) or when
// every normal of the cone faces away from the pixel at every point of the sphere (Sabbadin 2019, Figure 5, with the
// node's extent). `margin` is a length that the tests must hold with.
bool pixel_discards(vec3 to_node, float distance2, vec3 normal, float radius, Cone cone, float margin) {
    precise float height = exact_dot(normal, to_node);
    precise float top = height + radius + margin;
    if (top < 0.0) return true;
    // The least of n . v over the cone's normals n is d cos(phi + alpha) = a cos(alpha) - sqrt(d^2 - a^2) sin(alpha).
    precise float along = exact_dot(to_node, cone.axis);
    precise float reach = along * cone.cosine;
    precise float rest = reach - radius - margin;
    precise float along2 = along * along;
    precise float across2 = distance2 - along2;
    precise float cosine2 = cone.cosine * cone.cosine;
    precise float sine2 = 1.0 - cosine2;
    precise float lost2 = across2 * sine2;
    precise float rest2 = rest * rest;
    return cone.cosine > 0.0 && rest > 0.0 && rest2 > lost2;
}

// The node as a single pixel's traversal sees it.
uint decide_pixel(uint node, Area area, bool leaf, vec3 position, vec3 normal, float stop_sin2) {
    vec4 sphere = node_sphere(node);
    precise vec3 to_node = sphere.xyz - position;
    precise float distance2 = exact_dot(to_node, to_node);
    bool stops = !area.opens && pixel_stops(distance2, sphere.w, stop_sin2, leaf);
    if (stops && !PAPER_COVERAGE) {
        // What covers nothing is not rasterised: below the horizon, or facing away.
        precise float height = exact_dot(normal, to_node);
        precise float facing = exact_dot(area.vector, to_node);
        return height > 0.0 && facing < 0.0 ? STOP : DISCARD;
    }
    precise float margin = stops ? 0.0 : SLACK * (abs(to_node.x) + abs(to_node.y) + abs(to_node.z) + sphere.w);
    if (pixel_discards(to_node, distance2, normal, sphere.w, node_cone(node), margin)) return DISCARD;
    return stops ? STOP : DESCEND;
}

// The same decision for every pixel of a receiver with a sphere of positions and a cone of normals.
uint decide_coarse(uint node, Area area, bool leaf, uint level, vec4 receiver_ball, vec4 receiver_normals,
                   float stop_sin2) {
    vec4 sphere = node_sphere(node);
    vec3 to_node = sphere.xyz - receiver_ball.xyz;
    float distance2 = dot(to_node, to_node);
    float centre_distance = sqrt(distance2);
    float extent = receiver_ball.w + sphere.w;
    float margin = SLACK * (centre_distance + extent);

    // The most and least of n . v over the receiver's normals n: d cos(phi - gamma) and d cos(phi + gamma), or d and -d
    // inside the cone and opposite to it (Sabbadin 2019, Eq. 8).
    float along = dot(receiver_normals.xyz, to_node);
    float gamma_sine = sqrt(max(0.0, 1.0 - receiver_normals.w * receiver_normals.w));
    float reach = along * receiver_normals.w;
    float swing = sqrt(max(0.0, distance2 - along * along)) * gamma_sine;
    float edge = centre_distance * receiver_normals.w;
    float top = along >= edge ? centre_distance : reach + swing;
    float bottom = along <= -edge ? -centre_distance : reach - swing;
    if (top + extent + margin < 0.0) return DISCARD;

    Cone cone = node_cone(node);
    float along_cone = dot(to_node, cone.axis);
    float sine = sqrt(max(0.0, 1.0 - cone.cosine * cone.cosine));
    float least = along_cone * cone.cosine - sqrt(max(0.0, distance2 - along_cone * along_cone)) * sine;
    if (cone.cosine > 0.0 && least > extent + margin) return DISCARD;

    float nearest = max(0.0, centre_distance - receiver_ball.w);
    float farthest = centre_distance + receiver_ball.w;
    float radius2 = sphere.w * sphere.w;
    if (!area.opens && (leaf || radius2 <= stop_sin2 * nearest * nearest * (1.0 - 1e-4))) {
        if (PAPER_COVERAGE) return STOP;
        // As for single pixels: what covers nothing is not rasterised. Where pixels differ, those below the next level
        // are asked, unless so few are left that offering it to all of them costs less.
        float reached = receiver_ball.w + margin;
        float facing = dot(area.vector, to_node);
        float spread = length(area.vector) * reached;
        if (top + reached < 0.0 || facing - spread > 0.0) return DISCARD;
        bool covers_all = bottom - reached > 0.0 && facing + spread < 0.0;
        return covers_all || level <= UNDIVIDED ? STOP : SPLIT;
    }
    if (area.opens || radius2 > stop_sin2 * farthest * farthest * (1.0 + 1e-4)) return DESCEND;
    return SPLIT;
}

// A tile of the technique `shared` takes one cut for all its pixels, as seen from its middle; only what none of them
// and none of the pixels around it (whose normals are in its cone) can see is left out. It is never split here.
uint decide_tile(uint node, Area area, bool leaf, vec3 middle, vec4 tile_normals, float stop_sin2) {
    vec4 sphere = node_sphere(node);
    precise vec3 to_node = sphere.xyz - middle;
    precise float distance2 = exact_dot(to_node, to_node);
    float centre_distance = sqrt(distance2);
    bool stops = !area.opens && pixel_stops(distance2, sphere.w, stop_sin2, leaf);
    // As for coarse receivers; with a texel to spare, so that those at the horizon get all that they show: a node that
    // stops has a solid angle of about four texels.
    float margin = SLACK * (centre_distance + sphere.w) + centre_distance * sqrt(stop_sin2);
    float along = dot(tile_normals.xyz, to_node);
    float sine = sqrt(max(0.0, 1.0 - tile_normals.w * tile_normals.w));
    float swing = sqrt(max(0.0, distance2 - along * along)) * sine;
    float top = along >= centre_distance * tile_normals.w ? centre_distance : along * tile_normals.w + swing;
    if (top + sphere.w + margin < 0.0) return DISCARD;
    if (stops) return exact_dot(area.vector, to_node) < 0.0 ? STOP : DISCARD;
    Cone cone = node_cone(node);
    float along_cone = dot(to_node, cone.axis);
    float cone_sine = sqrt(max(0.0, 1.0 - cone.cosine * cone.cosine));
    float least = along_cone * cone.cosine - sqrt(max(0.0, distance2 - along_cone * along_cone)) * cone_sine;
    return cone.cosine > 0.0 && least > sphere.w + margin ? DISCARD : DESCEND;
}

// The paper's rule (Sabbadin 2019, 5.2.1): compare the node's solid angle with that of the receiver's normal cone,
// as if the receiver had no extent, and stop at pixels alone.
uint decide_paper(uint node, bool leaf, uint level, vec3 position, vec4 receiver_normals, float stop_sin2) {
    vec4 sphere = node_sphere(node);
    precise vec3 to_node = sphere.xyz - position;
    precise float distance2 = exact_dot(to_node, to_node);
    float centre_distance = sqrt(distance2);
    // Eqs. 6 to 8: phi - alpha > gamma + pi / 2.
    float phi = acos(clamp(dot(receiver_normals.xyz, to_node) / max(centre_distance, 1e-20), -1.0, 1.0));
    float alpha = asin(clamp(sphere.w / max(centre_distance, 1e-20), 0.0, 1.0));
    float gamma = acos(clamp(receiver_normals.w, -1.0, 1.0));
    if (phi - alpha > gamma + 1.57079633) return DISCARD;
    // Figure 5: the cone of visibility, of the node's centre alone.
    Cone cone = node_cone(node);
    float sine = sqrt(max(0.0, 1.0 - cone.cosine * cone.cosine));
    if (cone.cosine > 0.0 && dot(to_node, cone.axis) > sine * centre_distance && centre_distance > sphere.w) {
        return DISCARD;
    }
    bool small = pixel_stops(distance2, sphere.w, stop_sin2, false);
    if (level == 0u) return small || leaf ? STOP : DESCEND;
    // Omega(p) = 2 pi (1 - cos gamma): the same test without a root, with the receiver's cone as the threshold.
    float receiver_sin2 = 1.0 - receiver_normals.w * receiver_normals.w;
    bool descends = receiver_normals.w > 0.0 ? sphere.w * sphere.w > receiver_sin2 * distance2
                                          : centre_distance <= sphere.w;
    // A node that is already small enough for the micro-buffer is never opened for a sharper receiver.
    return descends && !leaf && !small ? DESCEND : SPLIT;
}

uint decide(uint node, Area area, uint level, vec4 receiver_ball, vec4 receiver_normals, float stop_sin2) {
    bool leaf = area.skip == node + 1u;
    if (SHARED) return decide_tile(node, area, leaf, receiver_ball.xyz, receiver_normals, stop_sin2);
    if (PAPER_CUT) return decide_paper(node, leaf, level, receiver_ball.xyz, receiver_normals, stop_sin2);
    if (level == 0u) return decide_pixel(node, area, leaf, receiver_ball.xyz, receiver_normals.xyz, stop_sin2);
    return decide_coarse(node, area, leaf, level, receiver_ball, receiver_normals, stop_sin2);
}
