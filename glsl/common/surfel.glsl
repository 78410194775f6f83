// Points of the cloud with their normals and spacings.

layout(binding = 0) uniform usamplerBuffer points;  // position as float bits, colour in RGB9E5
layout(binding = 1) uniform usamplerBuffer surfels; // normal on an octahedron, spacing as float bits

struct Surfel {
    vec3 position;
    vec3 normal;
    vec3 color;
    float spacing; // metres
};

Surfel load_surfel(int index) {
    uvec4 point = texelFetch(points, index);
    uvec2 bits = texelFetch(surfels, index).xy;
    vec2 place = unpackSnorm2x16(bits.x);
    vec3 normal = vec3(place, 1.0 - abs(place.x) - abs(place.y));
    if (normal.z < 0.0) normal.xy = (1.0 - abs(place.yx)) * vec2(place.x < 0.0 ? -1.0 : 1.0, place.y < 0.0 ? -1.0 : 1.0);
    return Surfel(uintBitsToFloat(point.xyz), normalize(normal), unpack_rgb9e5(point.w), uintBitsToFloat(bits.y));
}
