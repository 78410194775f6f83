// Fixed-point sums of a micro-pixel, two layers (front and back) of four 32-bit numbers: red, green, blue in units of
// 1 / color_scale, coverage in units of 2^-20 micro-pixels. Added as 64-bit words of two numbers each.
const float COVERAGE_ONE = 1048576.0;
