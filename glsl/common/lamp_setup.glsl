// Lamps as views, and what all surfaces are made of (`LampSetup` in passes/lamp_view.rs).

layout(binding = 20) uniform samplerBuffer lamp_setup;

const uint SPOT = 0u;
const uint POINT = 1u;
const uint SUN = 2u;

// Shares of the light that surfaces reflect: diffusely, times their colour, and as a mirror's lobe (Phong, normalised).
struct Surfaces {
    float diffuse;
    float specular;
    float shininess;
    float area; // square metres of the cloud for each virtual light
};

struct LampView {
    vec3 eye;
    float focal; // pixels
    vec3 right;
    float cone; // cosine of a spot's half angle
    vec3 down;
    uint kind;
    vec3 forward;
    vec3 strength; // radiant intensity; irradiance of a sun
};

Surfaces load_surfaces() {
    vec4 head = texelFetch(lamp_setup, 0);
    return Surfaces(head.x, head.y, head.z, head.w);
}

LampView load_lamp_view(uint view) {
    int at = 1 + 5 * int(view);
    vec4 a = texelFetch(lamp_setup, at), b = texelFetch(lamp_setup, at + 1), c = texelFetch(lamp_setup, at + 2);
    vec3 forward = texelFetch(lamp_setup, at + 3).xyz, strength = texelFetch(lamp_setup, at + 4).xyz;
    return LampView(a.xyz, a.w, b.xyz, b.w, c.xyz, uint(c.w), forward, strength);
}

// First texel of a level of the importance pyramid over the atlas of all views.
int importance_level(uint level) {
    uint whole = lamp_pass.side * lamp_pass.light_size, own = whole >> level;
    return int((whole * whole - own * own) / 3u * 4u);
}

// Texel of a pixel of a view in the atlas.
int lamp_texel(uint view, ivec2 pixel) {
    ivec2 corner = ivec2(view % lamp_pass.side, view / lamp_pass.side) * int(lamp_pass.light_size);
    return (corner.y + pixel.y) * int(lamp_pass.side * lamp_pass.light_size) + corner.x + pixel.x;
}

float luminance(vec3 color) { return dot(color, vec3(0.2126, 0.7152, 0.0722)); }

// Share of the light that a surface of this albedo reflects in all.
float reflectance(Surfaces surfaces, vec3 albedo) { return surfaces.diffuse * luminance(albedo) + surfaces.specular; }

// Normalised Phong lobe around the mirror image of `towards`, the direction to the light.
float phong(Surfaces surfaces, vec3 normal, vec3 towards, vec3 out_) {
    float cosine = dot(reflect(-towards, normal), out_);
    return cosine > 0.0 ? surfaces.specular * (surfaces.shininess + 2.0) * 0.159154943 * pow(cosine, surfaces.shininess) : 0.0;
}
