// Push constants of the point passes (`PointView` in passes/points.rs). View space: x right, y down, z away from the eye,
// metres, so that a pixel's ray is ((pixel - middle) / focal, 1).
layout(push_constant) uniform PointView {
    vec3 eye;
    float focal; // distance to the image plane, pixels
    vec3 right;
    float near;
    vec3 down;
    float spacing; // s_0, metres
    vec3 forward;
    uint width; // of the image
    uint height;
    uint level; // that the pass writes
    uint level_width;
    uint level_height;
    uint source; // first texel of the level that it reads
    uint target; // first texel of the level that it writes
    uint first; // point of the dispatch
    uint count; // points of the dispatch
    uint display;
    uint levels; // of all pyramids
} point_view;

vec3 pixel_ray(vec2 pixel) {
    return vec3((pixel - 0.5 * vec2(point_view.width, point_view.height)) / point_view.focal, 1.0);
}

vec3 view_from_world(vec3 position) {
    vec3 from_eye = position - point_view.eye;
    return vec3(dot(from_eye, point_view.right), dot(from_eye, point_view.down), dot(from_eye, point_view.forward));
}
