// The surface that a pixel shows, from the G-buffer.
layout(constant_id = 8) const uint MATERIAL = 0u; // 0 from the file, 1 diffuse, 2 metal

layout(binding = 17) uniform sampler2D normal_map;
layout(binding = 18) uniform sampler2D base_metallic_map;
layout(binding = 19) uniform sampler2D emissive_roughness_map;

struct Surface {
    vec3 base_color;
    float metallic;
    vec3 emissive;
    float roughness;
    float specular;
    bool sharp; // the lobe has a buffer of its own
};

uint output_index(ivec2 texel) { return uint(texel.y) * gather.width + uint(texel.x); }

Surface load_surface(ivec2 texel) {
    vec4 base_metallic = texelFetch(base_metallic_map, texel, 0);
    vec4 emissive_roughness = texelFetch(emissive_roughness_map, texel, 0);
    bool sharp = MATERIAL == 2u ? gather.material_parameter < gather.sharp_alpha : emissive_roughness.a < 0.0;
    return Surface(base_metallic.rgb, base_metallic.a, emissive_roughness.rgb, abs(emissive_roughness.a),
                   texelFetch(normal_map, texel, 0).a, sharp);
}
