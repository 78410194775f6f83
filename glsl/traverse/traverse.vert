#version 460
// Hands a pair to the geometry shader.
layout(location = 0) in uvec2 pair;
layout(location = 0) out uvec2 pair_out;

void main() {
    pair_out = pair;
    gl_Position = vec4(0.0);
}
