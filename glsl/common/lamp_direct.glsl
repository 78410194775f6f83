// Light straight from the lamps, by their shadow maps (Preiner 2010, section 3).

layout(binding = 23) uniform samplerBuffer lamp_places; // position, depth or 0

// Widths of a texel that an occluder must be nearer; a sun's view has its depths a long way off.
const float SHADOW_BIAS = 3.0;

// Share of four texels around the place in the view that see the pixel's plane.
float lit_share(uint index, LampView view, vec3 local, vec3 normal_world) {
    vec3 normal = vec3(dot(normal_world, view.right), dot(normal_world, view.down), dot(normal_world, view.forward));
    vec2 place = local.xy / local.z * view.focal + 0.5 * float(lamp_pass.light_size) - 0.5;
    vec2 corner = floor(place), part = place - corner;
    float share = 0.0;
    for (int k = 0; k < 4; ++k) {
        ivec2 side = ivec2(k & 1, k >> 1);
        ivec2 at = clamp(ivec2(corner) + side, ivec2(0), ivec2(lamp_pass.light_size) - 1);
        float depth = texelFetch(lamp_places, lamp_texel(index, at)).w;
        vec3 ray = vec3((vec2(at) + 0.5 - 0.5 * float(lamp_pass.light_size)) / view.focal, 1.0);
        float towards = dot(normal, ray);
        float planar = towards < 0.0 ? dot(normal, local) / towards : local.z;
        bool lit = depth == 0.0 || clamp(planar, 0.5 * local.z, local.z) - SHADOW_BIAS * local.z / view.focal <= depth;
        vec2 shares = mix(1.0 - part, part, vec2(side));
        if (lit) share += shares.x * shares.y;
    }
    return share;
}

// Irradiance of a surface from one view of a lamp, and the direction to that.
vec3 lamp_irradiance(uint index, vec3 position, vec3 normal, out vec3 towards) {
    LampView view = load_lamp_view(index);
    vec3 from = position - view.eye;
    float distance2 = dot(from, from);
    towards = view.kind == SUN ? -view.forward : -from * inversesqrt(max(distance2, 1e-30));
    vec3 local = vec3(dot(from, view.right), dot(from, view.down), dot(from, view.forward));
    // Points have six views that touch.
    bool inside = local.z > 0.0 && max(abs(local.x), abs(local.y)) * view.focal <= 0.5 * float(lamp_pass.light_size) * local.z;
    if (!inside || (view.kind == SPOT && local.z < view.cone * sqrt(distance2))) return vec3(0.0);
    float cosine = dot(normal, towards);
    if (cosine <= 0.0) return vec3(0.0);
    return view.strength * (cosine * lit_share(index, view, local, normal) / (view.kind == SUN ? 1.0 : distance2));
}
