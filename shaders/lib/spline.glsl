// Smooth reconstructions: cubics of four coefficients along every axis, and their bicubic on a face of the box.
// Source: Sigg and Hadwiger 2005, "Fast third-order texture filtering" (tensor-product weights, paired taps).
// Twin: isosample/integral/spline.py

// Weights of the four taps at the fraction `u`: the rows of the kernel are cubics of u.
vec4 tap_weights(vec4 kernel[4], float u) {
    vec4 powers = vec4(1.0, u, u * u, u * u * u);
    return vec4(dot(kernel[0], powers), dot(kernel[1], powers), dot(kernel[2], powers), dot(kernel[3], powers));
}

// Derivatives of the weights with respect to the fraction.
vec4 tap_slopes(vec4 kernel[4], float u) {
    vec3 powers = vec3(1.0, 2.0 * u, 3.0 * (u * u));
    return vec4(dot(kernel[0].yzw, powers), dot(kernel[1].yzw, powers), dot(kernel[2].yzw, powers), dot(kernel[3].yzw, powers));
}

// Two taps of one sign side by side as one linear fetch: its weight, and how far it lies from the first to the second.
vec2 paired_taps(vec2 weights) {
    float sum = weights.x + weights.y;
    return vec2(sum, sum == 0.0 ? 0.0 : weights.y / sum);
}

// Weighted sum of four coefficients of one z, x running first, then y.
float weighed_quad(vec4 quad, vec2 weights_x, vec2 weights_y) {
    return dot(weights_y, vec2(dot(quad.xy, weights_x), dot(quad.zw, weights_x)));
}

// The bicubic; taps[j] holds the four coefficients along the first axis in row j.
float spline_face_value(vec4 taps[4], vec4 weights_u, vec4 weights_v) {
    return dot(weights_v, vec4(dot(taps[0], weights_u), dot(taps[1], weights_u), dot(taps[2], weights_u),
                               dot(taps[3], weights_u)));
}

// Second differences of four numbers in a row, the larger one.
float largest_bend(vec4 row) { return max(abs(row.x - 2.0 * row.y + row.z), abs(row.y - 2.0 * row.z + row.w)); }

// Largest difference of normalised values between the bicubic and what the mesh's outline on the face stands for: see
// face_tolerance. A chord leaves its isoline by (bend along u + bend along v) / 8 + |mixed difference| / 4.
float spline_face_tolerance(vec4 taps[4]) {
    mat4 across = transpose(mat4(taps[0], taps[1], taps[2], taps[3]));
    float bend = 0.0;
    float bend_across = 0.0;
    float low = taps[0].x;
    float high = low;
    for (int j = 0; j < 4; ++j) {
        bend = max(bend, largest_bend(taps[j]));
        bend_across = max(bend_across, largest_bend(across[j]));
        low = min(low, min(min(taps[j].x, taps[j].y), min(taps[j].z, taps[j].w)));
        high = max(high, max(max(taps[j].x, taps[j].y), max(taps[j].z, taps[j].w)));
    }
    float mixed = abs(taps[1].y - taps[1].z - taps[2].y + taps[2].z);
    return 0.125 * (bend + bend_across) + 0.25 * mixed + 0.02 * (high - low) + 1e-5;
}
