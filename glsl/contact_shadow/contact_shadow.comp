#version 460
// How much of its light the object takes from the scan around it: cones through a distance field of the object towards
// directions from which light comes (differential rendering, Debevec 1998, with cones as in Crassin et al. 2011). Not in
// the papers.
#extension GL_GOOGLE_include_directive : require
#include "shared/point_view.glsl"

layout(local_size_x = 256) in;

layout(binding = 0) uniform samplerBuffer shaded_in; // colour, depth
layout(binding = 1) uniform samplerBuffer shaded_normals_in;
layout(binding = 2) uniform samplerBuffer field; // distances, metres in the object's space
// The grid's first point and cell; its size; three rows of object from world; centre and radius of the object in world
// space; then a direction and its radiance for each cone.
layout(binding = 3) uniform samplerBuffer shadow_setup;
layout(binding = 4, rgba32f) uniform writeonly imageBuffer shadow; // share of the light that is left, by channel

layout(constant_id = 0) const uint CONES = 32u;

// Half the width of a cone: a cone through whose axis the surface passes is half closed.
const float TANGENT = 0.18;
const uint MOST_STEPS = 20u;
// Radii of the object within which there is shadow, and from where on it fades.
const vec2 REACH = vec2(4.0, 2.5);

vec3 low;
float cell;
ivec3 size;

float distance_at(vec3 place) {
    // Outside the grid: how far the grid is, and what it has at its border.
    vec3 at = (place - low) / cell;
    vec3 inside = clamp(at, vec3(0.0), vec3(size - 1) - 1e-3);
    ivec3 corner = ivec3(inside);
    vec3 part = inside - vec3(corner);
    float sum = 0.0;
    for (int k = 0; k < 8; ++k) {
        ivec3 side = ivec3(k & 1, (k >> 1) & 1, k >> 2);
        ivec3 p = min(corner + side, size - 1);
        vec3 share = mix(1.0 - part, part, vec3(side));
        sum += texelFetch(field, (p.z * size.y + p.y) * size.x + p.x).x * share.x * share.y * share.z;
    }
    return sum + length(at - inside) * cell;
}

// Share of a cone from `place` that nothing closes, both in the object's space.
float open_share(vec3 place, vec3 direction, float most) {
    float open = 1.0;
    float t = 1.5 * cell;
    for (uint k = 0u; k < MOST_STEPS && t < most && open > 0.02; ++k) {
        float near = distance_at(place + direction * t);
        open = min(open, max(0.0, near - 0.5 * cell) / (t * TANGENT));
        t += max(near, 0.5 * cell);
    }
    return open;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= point_view.width * point_view.height) return;
    vec4 grid = texelFetch(shadow_setup, 0);
    low = grid.xyz;
    cell = grid.w;
    size = ivec3(texelFetch(shadow_setup, 1).xyz);
    vec4 rows[3] = vec4[3](texelFetch(shadow_setup, 2), texelFetch(shadow_setup, 3), texelFetch(shadow_setup, 4));
    vec4 bounds = texelFetch(shadow_setup, 5);

    float depth = texelFetch(shaded_in, int(index)).w;
    vec4 normal = texelFetch(shaded_normals_in, int(index));
    vec2 pixel = vec2(index % point_view.width, index / point_view.width) + 0.5;
    vec3 view = pixel_ray(pixel) * depth;
    vec3 position = point_view.eye + point_view.right * view.x + point_view.down * view.y + point_view.forward * view.z;
    float away = distance(position, bounds.xyz) / bounds.w;
    if (depth == 0.0 || normal.w == 0.0 || away > REACH.x) {
        imageStore(shadow, int(index), vec4(1.0));
        return;
    }
    vec3 place = vec3(dot(rows[0], vec4(position, 1.0)), dot(rows[1], vec4(position, 1.0)), dot(rows[2], vec4(position, 1.0)));
    float scale = length(vec3(rows[0].x, rows[1].x, rows[2].x));
    float most = 2.0 * REACH.x * bounds.w * scale;
    vec3 all = vec3(0.0);
    vec3 left = vec3(0.0);
    for (uint k = 0u; k < CONES; ++k) {
        vec3 direction = texelFetch(shadow_setup, int(6u + 2u * k)).xyz;
        float cosine = dot(direction, normal.xyz);
        if (cosine <= 0.0) continue;
        vec3 light = texelFetch(shadow_setup, int(7u + 2u * k)).rgb * cosine;
        all += light;
        // Cones that pass the object's sphere stay open.
        vec3 to = bounds.xyz - position;
        float along = dot(to, direction);
        float across2 = dot(to, to) - along * along;
        float reach = bounds.w * 1.1 + max(0.0, along) * TANGENT;
        bool passes = across2 > reach * reach || (along < 0.0 && dot(to, to) > bounds.w * bounds.w);
        vec3 turned = vec3(dot(rows[0].xyz, direction), dot(rows[1].xyz, direction), dot(rows[2].xyz, direction)) / scale;
        left += passes ? light : light * open_share(place, turned, most);
    }
    vec3 kept = vec3(all.r > 0.0 ? left.r / all.r : 1.0, all.g > 0.0 ? left.g / all.g : 1.0, all.b > 0.0 ? left.b / all.b : 1.0);
    float fade = 1.0 - smoothstep(REACH.y, REACH.x, away);
    imageStore(shadow, int(index), vec4(mix(vec3(1.0), kept, fade), 1.0));
}
