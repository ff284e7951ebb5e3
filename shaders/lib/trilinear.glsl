// The trilinear field in one cell of the grid, and the slopes of the samples that it interpolates for shading.
// Four samples of a cell with one z stand in a vec4: x runs first, then y.
// Twin: isosample/integral/trilinear.py

// Interpolation of the eight samples around a place, at the fractions of a sample step behind the first of them.
// Linear beyond the cell too.
float trilinear(vec4 low, vec4 high, vec3 fraction) {
    vec4 between = mix(low, high, fraction.z);
    vec2 row = mix(between.xy, between.zw, fraction.y);
    return mix(row.x, row.y, fraction.x);
}

// Central differences at four samples per sample step, with their neighbours on either side; one-sided where the other
// neighbour is above `limit`, which marks what is not there, and 0 between two such.
vec4 sample_slopes(vec4 behind, vec4 here, vec4 ahead, float limit) {
    bvec4 no_back = greaterThan(behind, vec4(limit));
    bvec4 no_front = greaterThan(ahead, vec4(limit));
    vec4 steps = vec4(2.0) - vec4(no_back) - vec4(no_front);
    return (mix(ahead, here, no_front) - mix(behind, here, no_back)) / max(steps, vec4(1.0));
}
