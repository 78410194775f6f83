// How far apart in depth points of a surface may lie within a pixel: a share of the depth, but no more than some widths of
// the pixel, since a sun's view has all its depths a long way off.
float same_surface(float depth) { return depth * min(0.05, 8.0 / point_view.focal); }
