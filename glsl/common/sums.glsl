// Fixed-point sums of a micro-pixel, two layers (front and back) of four 32-bit numbers: red, green, blue in units of
// 1 / color_scale, coverage in units of 2^-20 micro-pixels. Integers, so that the order of nodes does not matter.
const float COVERAGE_ONE = 1048576.0;

// Weight of a colour in the sums that say where in a texel its light comes from (technique `shared`).
float brightness(vec3 color) { return 0.25 * color.r + 0.5 * color.g + 0.25 * color.b; }
