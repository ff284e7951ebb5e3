// Opacity, transmittance and the emission integral of one stretch of a ray.
// Source: Max 1995 (optical models); the linear slab by parts, see segment_weights.
// Twin: isosample/integral/optics.py

const float SERIES_LIMIT = 0.5;          // below this optical depth 1 - exp(-x) would cancel
const float PANEL_DEPTH = 0.5;           // optical depth of one quadrature panel
const int MAX_PANELS = 36;               // 36 panels of depth 1/2: what is left weighs exp(-18) = 1.5e-8 < 2^-24

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

// 1 - exp(-x) of four depths x in [0, PANEL_DEPTH].
//   Taylor series to x^8/8!: truncated relative error x^8/9! < 1.1e-8.
vec4 opacity_of_panel(vec4 x) {
    vec4 s = 1.0 / 5040.0 - x * (1.0 / 40320.0);
    s = 1.0 / 720.0 - x * s;
    s = 1.0 / 120.0 - x * s;
    s = 1.0 / 24.0 - x * s;
    s = 1.0 / 6.0 - x * s;
    s = 0.5 - x * s;
    s = 1.0 - x * s;
    return x * s;
}

// Weights of the front and the back colour of a stretch in which extinction AND colour vary linearly:
// radiance = w.x * c_front + w.y * c_back, w.x + w.y = opacity.
//   By parts, with D(u) from partial_depth:  integral of c tau exp(-D) = c0 w.x + c1 w.y,
//     w.x = integral over [0, 1] of (1 - exp(-D(u))) du,    w.y = opacity - w.x.
//   w.x is taken on panels of optical depth <= 1/2 with 4 Gauss-Legendre nodes. On a panel the integrand is
//   1 - const exp(-a u - b u^2) with |8th derivative| <= 764 (reached where the extinction falls to 0 at its end),
//   so the error is at most 5.6e-10 * 764 = 4.3e-7 times its width and the transmittance before it: 4.3e-7 in all.
//   With the depth from the panel's own start, 1 - exp(-D) = b + (1 - b) (1 - exp(-d)), where b is what is blocked before
//   it: a short series is enough at the nodes.
// The loop ends with its condition: where one begins with it, software renderers execute it once more.
// Error: 4.3e-7 of the quadrature, exp(-18) = 1.5e-8 behind the last panel, gamma(56) of roundings at the very worst:
// |err| <= 3.8e-6 for each weight and any x0, x1 >= 0 (3.2e-7 was seen). Where x0, x1 <= 1/2 the relative error of w.x
// is below gamma(28) + 4e-7: thin stretches keep their colour.
vec2 segment_weights(float x0, float x1) {
    const vec4 nodes = vec4(0.069431844202973712, 0.33000947820757187, 0.66999052179242813, 0.93056815579702629);
    const vec4 shares = vec4(0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693);
    float opacity = opacity_from_depth(0.5 * (x0 + x1));
    float front = 0.0;
    float u = 0.0;
    int panel = 0;
    do {
        float end = panel_end(x0, x1, u);
        float width = end - u;
        float blocked = opacity_from_depth(partial_depth(x0, x1, u));
        vec4 depths = nodes * (width * (x0 + u * (x1 - x0)) + 0.5 * nodes * (width * (width * (x1 - x0))));
        front += width * (blocked + (1.0 - blocked) * dot(shares, opacity_of_panel(depths)));
        u = end;
        ++panel;
    } while (u < 1.0 && panel < MAX_PANELS);
    front = min(front + (1.0 - u), opacity); // past the last panel the opacity is 1 to float32 rounding
    return vec2(front, opacity - front);
}
