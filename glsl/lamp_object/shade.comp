#version 460
// What an object reflects of the light that comes straight from the lamps.
#extension GL_GOOGLE_include_directive : require
#include "shared/lamp_pass.glsl"
#include "common/lamp_setup.glsl"
#include "common/lamp_direct.glsl"
#include "common/brdf.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 8) const uint MATERIAL = 0u; // 0 from the file, 1 diffuse, 2 metal

layout(binding = 0) uniform sampler2D position_map; // w 1 where the object is
layout(binding = 1) uniform sampler2D normal_map;   // w is Disney's specular
layout(binding = 2) uniform sampler2D base_metallic_map;
layout(binding = 3) uniform sampler2D emissive_roughness_map;
layout(binding = 4, rgba32f) uniform writeonly imageBuffer output_image;

vec3 reflectance(ivec2 texel, vec3 normal, vec3 light, vec3 view) {
    if (MATERIAL == 1u) return vec3(lamp_pass.material / PI);
    Angles angles = angles_of(normal, light, view);
    if (angles.i <= 0.0 || angles.o <= 0.0) return vec3(0.0);
    if (MATERIAL == 2u) return vec3(ggx_lobe(angles, lamp_pass.material));
    vec4 base_metallic = texelFetch(base_metallic_map, texel, 0);
    float roughness = texelFetch(emissive_roughness_map, texel, 0).a;
    float specular = texelFetch(normal_map, texel, 0).a;
    return principled(angles, base_metallic.rgb, base_metallic.a, roughness, specular, 1.0);
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= lamp_pass.width * lamp_pass.height) return;
    ivec2 texel = ivec2(index % lamp_pass.width, index / lamp_pass.width);
    vec4 position = texelFetch(position_map, texel, 0);
    vec3 normal = texelFetch(normal_map, texel, 0).xyz;
    vec3 radiance = vec3(0.0), towards;
    for (uint k = 0u; k < lamp_pass.views && position.w > 0.0; ++k) {
        vec3 light = lamp_irradiance(k, position.xyz, normal, towards);
        if (light != vec3(0.0)) radiance += light * reflectance(texel, normal, towards, normalize(lamp_pass.eye - position.xyz));
    }
    imageStore(output_image, int(index), vec4(radiance, position.w));
}
