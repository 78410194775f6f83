// Fixed-point sums of a micro-pixel, two 64-bit words: red and green, blue and coverage, 32 bits each. Radiance is in
// units of 1 / color_scale, coverage in units of 2^-20 micro-pixels.
const float COVERAGE_ONE = 1048576.0;
