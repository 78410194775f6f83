// Whether a light sees a place, by its imperfect shadow map.

layout(binding = 22) uniform usamplerBuffer ism; // distances as float bits

// Part of the distance that an occluder must be nearer: some, and as much as surfaces that meet at an angle of 45 degrees
// differ within so many texels.
const float BIAS = 0.02;
const float TEXELS = 1.5;

// `to` is the way from the light to the place, in its frame; `normal` that of the place, in the same.
bool vpl_sees(uint index, vec3 to, float distance_, vec3 normal) {
    vec3 direction = to / distance_;
    ivec2 texel = min(ivec2(paraboloid_place(direction)), ivec2(lamp_pass.ism_size) - 1);
    uint bits = texelFetch(ism, ism_texel(index, 0u) + texel.y * int(lamp_pass.ism_size) + texel.x).x;
    if (bits == OPEN) return true;
    // The map knows the middle of the texel: there the plane of the place may be nearer than the place itself.
    float towards = dot(normal, paraboloid_direction(vec2(texel) + 0.5));
    float planar = towards < 0.0 ? dot(normal, to) / towards : distance_;
    float bias = BIAS + TEXELS * 2.0 * (1.0 + direction.z) / float(lamp_pass.ism_size);
    return clamp(planar, 0.5 * distance_, distance_) * (1.0 - bias) <= uintBitsToFloat(bits);
}
