// Unit vector to the eye. A normal map may turn the normal away from a viewer that sees the surface: it is lit as if
// seen edge-on.
vec3 view_of(vec3 position, vec3 normal) {
    vec3 view = normalize(gather.eye - position);
    float view_cosine = dot(view, normal);
    return view_cosine < 1e-3 ? normalize(view + normal * (1e-3 - view_cosine)) : view;
}
