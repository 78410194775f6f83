// Crosses the Rust border: passes::gbuffer::Draw.
layout(push_constant) uniform Draw {
    mat4 clip_from_world;
    vec4 base_color_metallic;
    vec4 emissive_roughness;
    vec3 eye;
    float normal_scale;
    float alpha_cutoff;
    float specular;
    float sharp_alpha; // lobes with a smaller GGX alpha may have buffers of their own
    uint textures; // bit 0 base colour, 1 metallic-roughness, 2 normal, 3 emissive
} draw;
