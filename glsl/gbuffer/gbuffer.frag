#version 460
// The G-buffer (Sabbadin 2019, 5.2).
#extension GL_GOOGLE_include_directive : require
#include "shared/draw.glsl"
#include "common/gbuffer_surface.glsl"

void main() { write_surface(); }
