// Opacity, transmittance and the emission integral of one stretch of a ray.
// Source: Max 1995 (optical models); the linear slab by parts, see segment_weights.
// Twin: isosample/integral/optics.py

const float SERIES_LIMIT = 0.5;          // below this optical depth 1 - exp(-x) would cancel
const float PANEL_DEPTH = 0.5;           // optical depth of a panel
const float PANEL_TRANSMITTANCE = 0.60653065971;  // exp(-PANEL_DEPTH)
const float LEAST_LEFT = 1.9e-8;         // behind 36 panels, exp(-18) = 1.5e-8 < 2^-24, nothing is summed

// Opacity of a path of optical depth x >= 0: 1 - exp(-x), without cancellation.
//   Taylor series to x^9/9! for x < 1/2: truncated relative error x^9/10! < 6e-10.
// Error: for x < 1/2 |err| <= gamma(4) opacity, since each step of the nested series passes on x/k <= 1/4 of the error
// of the step inside; else that of exp, 3 + 2x ulp of exp(-x): |err| <= 3.2e-7, which is 7e-7 opacity at most.
float opacity_from_depth(float x) {
    float s = 1.0 - x * (1.0 / 9.0);
    s = 1.0 - x * (1.0 / 8.0) * s;
    s = 1.0 - x * (1.0 / 7.0) * s;
    s = 1.0 - x * (1.0 / 6.0) * s;
    s = 1.0 - x * (1.0 / 5.0) * s;
    s = 1.0 - x * (1.0 / 4.0) * s;
    s = 1.0 - x * (1.0 / 3.0) * s;
    s = 1.0 - x * 0.5 * s;
    return x < SERIES_LIMIT ? x * s : 1.0 - exp(-x);
}

// Optical depth of the first part u in [0, 1] of a stretch whose extinction runs linearly from x0 to x1, both
// multiplied by the stretch's length.
//   D(u) = u (x0 + u (x1 - x0) / 2)
float partial_depth(float x0, float x1, float u) { return u * (x0 + 0.5 * u * (x1 - x0)); }

// Largest w such that the panel [u, w] has optical depth PANEL_DEPTH at most (1 if the rest has less).
// Root of s w'^2 / 2 + x_u w' = PANEL_DEPTH in the form that does not cancel, with s = x1 - x0, x_u = x0 + s u.
float panel_end(float x0, float x1, float u) {
    float s = x1 - x0;
    float x_u = x0 + s * u;
    float discriminant = x_u * x_u + 2.0 * s * PANEL_DEPTH;
    if (discriminant <= 0.0) return 1.0;
    float root = sqrt(discriminant);
    float step_u = 2.0 * PANEL_DEPTH / max(x_u + root, 1e-30);
    return min(1.0, u + step_u);
}

// Opacity of the parts [0, v] of a panel, averaged over v in [0, 1], whose depth is a v + b v^2, in [0, PANEL_DEPTH].
//   1 - exp(-x) ~ x (1 + c1 x + c2 x^2 + c3 x^3 + c4 x^4) to 9.1e-8 of itself (least for x <= 1/2), integrated term by term:
//   of v^k (a + b v)^k the factor of a^(k-j) b^j is binomial(k, j) / (k + j + 1).
float mean_opacity(float a, float b) {
    const float c1 = -0.49999464;
    const float c2 = 0.1665636;
    const float c3 = -0.041042484;
    const float c4 = 0.0068076085;
    float b_square = b * b;
    float a_square = a * a;
    float b0 = 0.5 * a + a_square * (c1 / 3.0 + a * (c2 / 4.0)) + a_square * a_square * (c3 / 5.0 + a * (c4 / 6.0));
    float b1 = 1.0 / 3.0 + a * (2.0 * c1 / 4.0) + a_square * (3.0 * c2 / 5.0 + a * (4.0 * c3 / 6.0) + a_square * (5.0 * c4 / 7.0));
    float b2 = c1 / 5.0 + a * (3.0 * c2 / 6.0) + a_square * (6.0 * c3 / 7.0 + a * (10.0 * c4 / 8.0));
    float b3 = c2 / 7.0 + a * (4.0 * c3 / 8.0) + a_square * (10.0 * c4 / 9.0);
    float b4 = c3 / 9.0 + a * (5.0 * c4 / 10.0) + b * (c4 / 11.0);
    return b0 + b * b1 + b_square * (b2 + b * b3 + b_square * b4);
}

// Weights of the front and the back colour of a stretch in which extinction AND colour vary linearly:
// radiance = w.x * c_front + w.y * c_back, w.x + w.y = opacity.
//   By parts, with D(u) from partial_depth:  integral of c tau exp(-D) = c0 w.x + c1 w.y,
//     w.x = integral over [0, 1] of (1 - exp(-D(u))) du,    w.y = opacity - w.x.
//   w.x is taken on panels of optical depth 1/2 (the last one has less): behind n of them exp(-n / 2) is left, and
//   1 - exp(-D) = 1 - exp(-n / 2) + exp(-n / 2) (1 - exp(-(D - n / 2))), the mean of which over the panel is known.
// The loop ends with its condition: where one begins with it, software renderers execute it once more.
// Error: 9.1e-8 / 2 of the polynomial, exp(-18) = 1.5e-8 behind the last panel, gamma(61) of roundings at the very worst:
// |err| <= 3.7e-6 (2.8e-7 was seen) for each weight and any x0, x1 >= 0. Where x0, x1 <= 1/2 the relative error of w.x is below
// gamma(28) + 1e-7: thin stretches keep their colour.
vec2 segment_weights(float x0, float x1) {
    float opacity = opacity_from_depth(0.5 * (x0 + x1));
    float rise = x1 - x0;
    float front = 0.0;
    float u = 0.0;
    float left = 1.0;
    do {
        float end = panel_end(x0, x1, u);
        float width = end - u;
        front += width * (1.0 - left + left * mean_opacity(width * (x0 + u * rise), 0.5 * width * (width * rise)));
        u = end;
        left *= PANEL_TRANSMITTANCE;
    } while (u < 1.0 && left > LEAST_LEFT);
    front = min(front + (1.0 - u), opacity); // past the last panel the opacity is 1 to float32 rounding
    return vec2(front, opacity - front);
}
