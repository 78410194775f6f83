// Writes a virtual point light (common/vpl.glsl).

layout(binding = 10, rgba32f) uniform writeonly imageBuffer vpl_out;

// Flux and direction from the previous light, and from the lamp.
struct Arriving {
    vec3 flux;
    vec3 towards;
    vec3 lamp_flux;
    vec3 lamp_towards;
};

void store_vpl(uint index, vec3 position, float area, vec3 normal, vec3 color, Arriving arriving) {
    int at = 8 * int(index);
    Surfaces surfaces = surfaces_of(color);
    // Of a diffuse surface: flux times albedo over pi.
    vec3 diffuse = (arriving.flux + arriving.lamp_flux) * albedo_of(color) * (surfaces.diffuse * 0.318309886);
    imageStore(vpl_out, at, vec4(position, area));
    imageStore(vpl_out, at + 1, vec4(normal, surfaces.specular));
    imageStore(vpl_out, at + 2, vec4(diffuse, surfaces.shininess));
    imageStore(vpl_out, at + 3, vec4(color, 0.0));
    imageStore(vpl_out, at + 4, vec4(arriving.flux, 0.0));
    imageStore(vpl_out, at + 5, vec4(arriving.towards, 0.0));
    imageStore(vpl_out, at + 6, vec4(arriving.lamp_flux, 0.0));
    imageStore(vpl_out, at + 7, vec4(arriving.lamp_towards, 0.0));
}

const Arriving NOTHING = Arriving(vec3(0.0), vec3(0.0, 0.0, 1.0), vec3(0.0), vec3(0.0, 0.0, 1.0));
