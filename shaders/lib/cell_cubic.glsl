// The field along a ray in one cell: a cubic of s in [0, 1] in Bernstein form, its extrema and its roots.
// The coefficients are blossoms of the trilinear interpolant, convex combinations of the eight samples: nothing cancels, and
// the cubic stays between the smallest and the largest coefficient. Source: Ramshaw 1989; Ament et al. 2010, section 5, has
// the same cubic through four samples.
// Four samples of a cell with one z stand in a vec4: x runs first, then y.
// Twin: isosample/integral/cell_cubic.py

const int CUBIC_ROOT_STEPS = 24;         // of bisection at worst, 2 or 3 of Newton's method
const float CUBIC_ROOT_TOLERANCE = 1e-4; // of [0, 1]: the last Newton step; what is left is its square times f'' / 2 f'

// Coefficients for the straight line between two places in a cell, with the samples of its lower and upper z.
vec4 cubic_between(vec4 low, vec4 high, vec3 start, vec3 end) {
    vec4 front = low.xzxz + start.x * (low.ywyw - low.xzxz);
    vec4 far_front = high.xzxz + start.x * (high.ywyw - high.xzxz);
    vec4 back = low.xzxz + end.x * (low.ywyw - low.xzxz);
    vec4 far_back = high.xzxz + end.x * (high.ywyw - high.xzxz);
    vec2 start_near = front.x + vec2(start.y, end.y) * (front.y - front.x);
    vec2 start_far = far_front.x + vec2(start.y, end.y) * (far_front.y - far_front.x);
    vec2 end_near = back.x + vec2(start.y, end.y) * (back.y - back.x);
    vec2 end_far = far_back.x + vec2(start.y, end.y) * (far_back.y - far_back.x);
    vec2 at_start = start_near + start.z * (start_far - start_near);        // blossoms f(start, y, start)
    vec2 start_at_end = start_near + end.z * (start_far - start_near);      // f(start, y, end)
    vec2 end_at_start = end_near + start.z * (end_far - end_near);          // f(end, y, start)
    vec2 at_end = end_near + end.z * (end_far - end_near);                  // f(end, y, end)
    return vec4(at_start.x, (end_at_start.x + at_start.y + start_at_end.x) / 3.0,
                (end_at_start.y + at_end.x + start_at_end.y) / 3.0, at_end.y);
}

// Coefficients of the cubic through values at s = 0, 1/3, 2/3 and 1.
vec4 cubic_through(vec4 samples) {
    return vec4(samples.x, (-5.0 * samples.x + 18.0 * samples.y - 9.0 * samples.z + 2.0 * samples.w) / 6.0,
                (2.0 * samples.x - 9.0 * samples.y + 18.0 * samples.z - 5.0 * samples.w) / 6.0, samples.w);
}

// Value at s.
float cubic_value(vec4 b, float s) {
    vec3 d = b.yzw - b.xyz;
    vec2 e = d.yz - d.xy;
    return b.x + s * (3.0 * d.x + s * (3.0 * e.x + s * (e.y - e.x)));
}

// Derivative with respect to s.
float cubic_slope(vec4 b, float s) {
    vec3 d = b.yzw - b.xyz;
    vec2 e = d.yz - d.xy;
    return 3.0 * (d.x + s * (2.0 * e.x + s * (e.y - e.x)));
}

// Places in (0, 1) where the slope changes its sign, ascending; 1 for those that are not there.
vec2 cubic_extrema(vec4 b) {
    vec3 d = b.yzw - b.xyz;
    if (all(greaterThanEqual(d, vec3(0.0))) || all(lessThanEqual(d, vec3(0.0)))) return vec2(1.0);
    float half_linear = d.y - d.x;
    float square = d.z - d.y - half_linear;   // square s^2 + 2 half_linear s + d.x
    float discriminant = half_linear * half_linear - square * d.x;
    if (discriminant <= 0.0) return vec2(1.0);
    float larger = -(half_linear + (half_linear < 0.0 ? -sqrt(discriminant) : sqrt(discriminant)));
    float first = larger != 0.0 ? d.x / larger : 2.0;
    float second = square != 0.0 ? larger / square : 2.0;
    first = first > 0.0 && first < 1.0 ? first : 1.0;
    second = second > 0.0 && second < 1.0 ? second : 1.0;
    return vec2(min(first, second), max(first, second));
}

// Place in [low, high] where a monotone piece takes the value `level`: Newton's method from the chord, inside a shrinking
// bracket, with bisection where a step would leave it. The caller knows that there is a root.
float cubic_root(vec4 b, float level, float low, float high, bool rising) {
    vec3 d = b.yzw - b.xyz;
    vec2 e = d.yz - d.xy;
    vec4 powers = vec4(b.x - level, 3.0 * d.x, 3.0 * e.x, e.y - e.x);
    float front = powers.x + low * (powers.y + low * (powers.z + low * powers.w));
    float back = powers.x + high * (powers.y + high * (powers.z + high * powers.w));
    float s = front != back ? clamp(low + (high - low) * front / (front - back), low, high) : low;
    for (int i = 0; i < CUBIC_ROOT_STEPS; ++i) {
        float residual = powers.x + s * (powers.y + s * (powers.z + s * powers.w));
        float slope = powers.y + s * (2.0 * powers.z + 3.0 * s * powers.w);
        bool below = (residual < 0.0) == rising;
        low = below ? s : low;
        high = below ? high : s;
        float next = slope != 0.0 ? s - residual / slope : -1.0;
        bool inside = next >= low && next <= high;
        if (!inside) next = 0.5 * (low + high);
        float change = abs(next - s);
        s = next;
        if (inside && change <= CUBIC_ROOT_TOLERANCE || change == 0.0) break;
    }
    return s;
}
