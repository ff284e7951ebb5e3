// Where the samples of a ray lie: T(x) = a x^2 / 2 + b x, with the sample's number x, the first step b and the growth a
// of the steps; a = 0 is uniform sampling.
// Source: Knoll et al. 2009, "Volume ray casting with peak finding and differential sampling", section 5.
// Twin: isosample/integral/sampling.py

// Length of the derivative of a ray's unit direction by the image plane's coordinate x: eq. 10, with the direction before
// it was made a unit vector and the image plane's vector along x.
//   |(d.d) u - (d.u) d| / (d.d)^(3/2) = |u - (u.d/d.d) d| / |d|
float direction_differential(vec3 direction, vec3 right) {
    float squared = dot(direction, direction);
    return length(right - dot(right, direction) / squared * direction) * inversesqrt(squared);
}

// T(x), eq. 15 with c = 0: in closed form, so that no rounding adds up along the ray.
float sample_distance(float first, float growth, float number) { return number * (first + 0.5 * growth * number); }

// x with T(x) = distance >= 0, eq. 18, in the form that does not cancel and holds for a = 0 too.
float sample_number(float first, float growth, float distance) {
    return 2.0 * distance / (first + sqrt(first * first + 2.0 * growth * distance));
}

// A number in [0, 1) for every pixel and seed: the output function of PCG (O'Neill 2014, RXS-M-XS), twice.
float pixel_noise(uvec2 pixel, uint seed) {
    uint state = seed + pixel.x * 747796405u + pixel.y * 2891336453u;
    for (int round = 0; round < 2; ++round) {
        state = state * 747796405u + 2891336453u;
        state = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
        state = (state >> 22) ^ state;
    }
    return float(state >> 8) * (1.0 / 16777216.0);
}
