// Writes a virtual point light (common/vpl.glsl).

layout(binding = 10, rgba32f) uniform writeonly imageBuffer vpl_out;

// Flux and direction from the previous light, and from the lamp.
struct Arriving {
    vec3 flux;
    vec3 towards;
    vec3 lamp_flux;
    vec3 lamp_towards;
};

void store_vpl(uint index, vec3 position, float area, vec3 normal, vec3 albedo, Arriving arriving, Surfaces surfaces) {
    int at = 8 * int(index);
    // Of a diffuse surface: flux times albedo over pi.
    vec3 diffuse = (arriving.flux + arriving.lamp_flux) * albedo * (surfaces.diffuse * 0.318309886);
    imageStore(vpl_out, at, vec4(position, area));
    imageStore(vpl_out, at + 1, vec4(normal, 0.0));
    imageStore(vpl_out, at + 2, vec4(diffuse, 0.0));
    imageStore(vpl_out, at + 3, vec4(albedo, 0.0));
    imageStore(vpl_out, at + 4, vec4(arriving.flux, 0.0));
    imageStore(vpl_out, at + 5, vec4(arriving.towards, 0.0));
    imageStore(vpl_out, at + 6, vec4(arriving.lamp_flux, 0.0));
    imageStore(vpl_out, at + 7, vec4(arriving.lamp_towards, 0.0));
}

const Arriving NOTHING = Arriving(vec3(0.0), vec3(0.0, 0.0, 1.0), vec3(0.0), vec3(0.0, 0.0, 1.0));
