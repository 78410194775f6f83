// Numbers that look random and are the same every time.

// PCG (Jarzynski and Olano 2020, Hash Functions for GPU Rendering).
uint hash(uint value) {
    uint state = value * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Above 0 and below 1.
float unit(uint bits) { return (float(bits >> 8u) + 0.5) / 16777216.0; }
