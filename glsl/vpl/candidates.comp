#version 460
// Every point of the cloud is a candidate for the next light of one path (Preiner 2010, 4.5); of all candidates of a light
// the one with the largest key stays. The paper's key is the best contribution, which would always take the same
// places and could not tell how much light they stand for. Here the key of a point of weight w is log w plus a Gumbel
// number of its own, the largest of which belongs to a point with a chance of exactly w over the sum of all.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#include "vpl/weight.glsl"
#include "common/vpl_visible.glsl"
#include "common/hash.glsl"
#include "common/light_of.glsl"

layout(local_size_x = 128) in;

layout(std430, binding = 2) buffer VplKeys { uint64_t vpl_keys[]; };
layout(std430, binding = 3) buffer VplWeights { uint vpl_weights[]; };

// A number that orders as floats do.
uint ordered(float value) {
    uint bits = floatBitsToUint(value);
    return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}

void main() {
    if (gl_GlobalInvocationID.x >= lamp_pass.count) return;
    uint index = lamp_pass.first + gl_GlobalInvocationID.x;
    uint number = lamp_pass.base + index;
    uint light = light_of(number);
    Surfel surfel = load_surfel(int(index));
    Candidate candidate = candidate_of(light, surfel);
    if (!(candidate.weight > 0.0)) return;
    mat3 frame = frame_of(load_vpl(light).normal);
    if (!vpl_sees(light, candidate.to * frame, length(candidate.to), surfel.normal * frame)) return;
    uint units = uint(min(candidate.weight, 1.0) / WEIGHT_UNIT + 0.5);
    if (units == 0u) return;
    atomicAdd(vpl_weights[light], units);
    float key = log(candidate.weight) - log(-log(unit(hash(number ^ hash(lamp_pass.bounce * 0x10000u + lamp_pass.offset)))));
    uint64_t entry = uint64_t(ordered(key)) << 32 | uint64_t(number);
    if (entry > vpl_keys[light]) atomicMax(vpl_keys[light], entry);
}
