// Virtual point lights (Preiner 2010, 4.2): what each is, how it shines, and its paraboloid map (Brabec et al. 2002).

// Eight texels each: place and the area it stands for; normal, and share of its mirror lobe; diffuse intensity along the
// normal, and the lobe's exponent; colour; flux from the previous light; direction to that; flux from the lamp;
// direction to that.
layout(binding = 21) uniform samplerBuffer vpl;

struct Vpl {
    vec3 position;
    float area;
    vec3 normal;
    vec3 diffuse; // intensity along the normal
};

Vpl load_vpl(uint index) {
    int at = 8 * int(index);
    vec4 place = texelFetch(vpl, at);
    return Vpl(place.xyz, place.w, texelFetch(vpl, at + 1).xyz, texelFetch(vpl, at + 2).xyz);
}

// What squared distances are at least: a light stands for an area, and the view from beside it has no singularity. A disc
// of that area seen from before its middle would have area / pi; a quarter of it takes less light away where surfaces
// meet, and with 64 lights the picture is not darker than with many.
float near_bound(Vpl light) { return light.area * 0.0795774715; }

// Flux from both sides.
vec3 load_flux(uint index) { return texelFetch(vpl, 8 * int(index) + 4).rgb + texelFetch(vpl, 8 * int(index) + 6).rgb; }

// What it sends in a direction by its lobes alone, before the cosine.
vec3 glossy_intensity(uint index, vec3 normal, vec3 out_) {
    int at = 8 * int(index);
    Surfaces surfaces = Surfaces(0.0, texelFetch(vpl, at + 1).w, texelFetch(vpl, at + 2).w);
    if (surfaces.specular == 0.0) return vec3(0.0);
    vec3 flux = texelFetch(vpl, at + 4).rgb, lamp_flux = texelFetch(vpl, at + 6).rgb, sum = vec3(0.0);
    // Mostly there is one of them.
    if (flux != vec3(0.0)) sum += flux * phong(surfaces, normal, texelFetch(vpl, at + 5).xyz, out_);
    if (lamp_flux != vec3(0.0)) sum += lamp_flux * phong(surfaces, normal, texelFetch(vpl, at + 7).xyz, out_);
    return sum;
}

// Two unit vectors that complete `normal` to a frame (Duff et al. 2017).
mat3 frame_of(vec3 normal) {
    float side = normal.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (side + normal.z), b = normal.x * normal.y * a;
    return mat3(vec3(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x),
                vec3(b, side + normal.y * normal.y * a, -normal.y), normal);
}

// Place on the map, 0 to its size along both sides, of a direction in the light's frame, z above 0. Angles are kept: a
// radian is (size / 2) / (1 + z) texels.
vec2 paraboloid_place(vec3 direction) {
    return (direction.xy / (1.0 + direction.z) * 0.5 + 0.5) * float(lamp_pass.ism_size);
}

// Unit direction of a place.
vec3 paraboloid_direction(vec2 place) {
    vec2 p = place * (2.0 / float(lamp_pass.ism_size)) - 1.0;
    float radius2 = dot(p, p);
    return vec3(2.0 * p, 1.0 - radius2) / (1.0 + radius2);
}

// First texel of a map's level in the atlas, where levels of all maps lie one after the other.
int ism_texel(uint map, uint level) {
    uint whole = lamp_pass.ism_size, own = whole >> level;
    return int((whole * whole - own * own) / 3u * 4u * lamp_pass.vpls + map * own * own);
}

// Empty texels of maps.
const uint OPEN = 0xffffffffu;
