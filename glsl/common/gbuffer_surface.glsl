// What a fragment of the object writes to the G-buffer: one sample at the pixel's centre (Sabbadin 2019, 5.2).
layout(set = 0, binding = 0) uniform sampler2D base_color_map;
layout(set = 0, binding = 1) uniform sampler2D metallic_roughness_map;
layout(set = 0, binding = 2) uniform sampler2D normal_map;
layout(set = 0, binding = 3) uniform sampler2D emissive_map;

layout(location = 0) in vec3 position_world;
layout(location = 1) in vec3 normal_world;
layout(location = 2) in vec4 tangent_world;
layout(location = 3) in vec2 uv;
layout(location = 0) out vec4 out_position; // w: 1 where covered
layout(location = 1) out vec4 out_normal;   // w: Disney's specular
layout(location = 2) out vec4 out_base_metallic;
layout(location = 3) out vec4 out_emissive_roughness; // roughness below zero: the lobe has a buffer of its own

// A lobe that reflects less than this share of what the surface does is not worth one.
const float LOBE_MATTERS = 0.5;

struct Fragment {
    vec3 vertex_normal; // towards the eye
    bool turned;        // the vertices' normal points away from it
    vec3 normal;        // with the normal map
};

bool has(uint texture_bit) { return (draw.textures & texture_bit) != 0u; }

Fragment write_surface() {
    vec4 base = vec4(draw.base_color_metallic.rgb, 1.0);
    if (has(1u)) base *= texture(base_color_map, uv);
    if (base.a < draw.alpha_cutoff) discard;
    float metallic = draw.base_color_metallic.w;
    float roughness = draw.emissive_roughness.w;
    if (has(2u)) {
        vec4 texel = texture(metallic_roughness_map, uv);
        roughness *= texel.g;
        metallic *= texel.b;
    }
    vec3 emissive = draw.emissive_roughness.rgb;
    if (has(8u)) emissive *= texture(emissive_map, uv).rgb;

    vec3 to_eye = draw.eye - position_world;
    Fragment fragment;
    fragment.vertex_normal = normalize(normal_world);
    // The side of the surface that the camera sees is the side that is lit.
    vec3 face = cross(dFdx(position_world), dFdy(position_world));
    if (dot(face, to_eye) < 0.0) face = -face;
    fragment.turned = dot(fragment.vertex_normal, face) < 0.0;
    if (fragment.turned) fragment.vertex_normal = -fragment.vertex_normal;
    vec3 normal = fragment.vertex_normal;
    if (has(4u) && dot(tangent_world.xyz, tangent_world.xyz) > 0.25) {
        vec3 tangent = normalize(tangent_world.xyz - normal * dot(normal, tangent_world.xyz));
        vec3 bitangent = cross(normal, tangent) * tangent_world.w;
        vec3 texel = texture(normal_map, uv).xyz * 2.0 - 1.0;
        texel.xy *= draw.normal_scale;
        normal = normalize(texel.x * tangent + texel.y * bitangent + texel.z * normal);
    }
    fragment.normal = normal;
    out_position = vec4(position_world, 1.0);
    out_normal = vec4(normal, draw.specular);
    out_base_metallic = vec4(base.rgb, metallic);
    const vec3 weights = vec3(0.2126, 0.7152, 0.0722);
    float lobe = dot(mix(vec3(0.08 * draw.specular), base.rgb, metallic), weights);
    float rest = dot(base.rgb, weights) * (1.0 - metallic);
    bool sharp = max(1e-3, roughness * roughness) < draw.sharp_alpha && lobe > LOBE_MATTERS * (lobe + rest);
    out_emissive_roughness = vec4(emissive, sharp ? -max(roughness, 1e-3) : roughness);
    return fragment;
}
