#version 460
// As gbuffer.vert, with the vertices' irradiance.
#extension GL_GOOGLE_include_directive : require
#include "shared/draw.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec2 uv;
layout(location = 0) out vec3 position_world;
layout(location = 1) out vec3 normal_world;
layout(location = 2) out vec4 tangent_world;
layout(location = 3) out vec2 uv_out;
layout(location = 4) out vec4 irradiance_out;

layout(constant_id = 2) const bool TRANSFER = true; // vertices have one
layout(binding = 4) uniform samplerBuffer vertex_irradiance;

void main() {
    position_world = position;
    normal_world = normal;
    tangent_world = tangent;
    uv_out = uv;
    irradiance_out = TRANSFER ? texelFetch(vertex_irradiance, gl_VertexIndex) : vec4(0.0);
    gl_Position = draw.clip_from_world * vec4(position, 1.0);
}
