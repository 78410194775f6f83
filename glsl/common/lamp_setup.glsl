// Lamps as views, and what surfaces are made of (`Materials` and `LampView` in passes/lamp_view.rs).

layout(binding = 20) uniform samplerBuffer lamp_setup;

const uint SPOT = 0u;
const uint POINT = 1u;
const uint SUN = 2u;

// Shares of the light that surfaces reflect: diffusely, times their colour, and as a mirror's lobe (Phong, normalised).
struct Surfaces {
    float diffuse;
    float specular;
    float shininess;
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

// Eight brushes and what comes before them.
const int FIRST_VIEW = 26;

// Square metres of the cloud for each virtual light.
float light_area() { return texelFetch(lamp_setup, 0).x; }

// Scans carry no material: it is a matter of the colour alone.
vec3 albedo_of(vec3 color) {
    float constant = texelFetch(lamp_setup, 0).y;
    return constant > 0.0 ? vec3(constant) : min(color, vec3(1.0));
}

Surfaces surfaces_of(vec3 color) {
    color = min(color, vec3(1.0));
    int brushes = int(texelFetch(lamp_setup, 0).z), at = 1;
    for (int k = 0; k < brushes && at == 1; ++k) {
        bool fits = all(greaterThanEqual(color, texelFetch(lamp_setup, 2 + 3 * k).rgb))
                 && all(lessThanEqual(color, texelFetch(lamp_setup, 3 + 3 * k).rgb));
        if (fits) at = 4 + 3 * k;
    }
    vec3 shares = texelFetch(lamp_setup, at).xyz;
    return Surfaces(shares.x, shares.y, shares.z);
}

LampView load_lamp_view(uint view) {
    int at = FIRST_VIEW + 5 * int(view);
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

// Share of the light that a surface of this colour reflects in all.
float reflectance(vec3 color) {
    Surfaces surfaces = surfaces_of(color);
    return surfaces.diffuse * luminance(albedo_of(color)) + surfaces.specular;
}

// Normalised Phong lobe around the mirror image of `towards`, the direction to the light.
float phong(Surfaces surfaces, vec3 normal, vec3 towards, vec3 out_) {
    if (surfaces.specular == 0.0) return 0.0;
    float cosine = dot(reflect(-towards, normal), out_);
    return cosine > 0.0 ? surfaces.specular * (surfaces.shininess + 2.0) * 0.159154943 * pow(cosine, surfaces.shininess) : 0.0;
}
