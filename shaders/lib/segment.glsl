// The field between two neighbouring crossings of a ray as a cubic, and the emission integral over it.
// Positions are those in a band: 0 at its lower isovalue, 1 at its upper one. Slopes are in band widths per segment.
// Source: cubic Hermite interpolation; Fritsch and Carlson 1980, "Monotone piecewise cubic interpolation" (limiter).
// Twin: isosample/integral/segment.py

const float SEGMENT_PANEL_DEPTH = 1.0;   // largest optical depth of one panel, unless MAX_SEGMENT_PANELS do not suffice
const int MAX_SEGMENT_PANELS = 24;
const float SEGMENT_SPENT = 5.9604645e-8; // less transmittance than this (2^-24) ends the integral
const float SEGMENT_LEAVES = 1e-3;       // part of the band by which a cubic may leave it: it is then clamped
const float SEGMENT_LEAVES_FAR = 0.02;   // further part over which the limiter sets in, so that the picture has no step

// Gauss-Legendre nodes and weights on [0, 1], and the integrals of their Lagrange polynomials from 0 to each node.
const vec3 SEGMENT_NODES = vec3(0.11270166537925831, 0.5, 0.88729833462074169);
const vec3 SEGMENT_WEIGHTS = vec3(0.27777777777777779, 0.44444444444444442, 0.27777777777777779);
const vec3 SEGMENT_BEFORE_FIRST = vec3(0.13888888888888889, -0.035976667524938911, 0.0097894440153083255);
const vec3 SEGMENT_BEFORE_SECOND = vec3(0.30026319498086457, 0.22222222222222221, -0.022485417203086805);
const vec3 SEGMENT_BEFORE_THIRD = vec3(0.26798833376246945, 0.48042111196938336, 0.13888888888888889);

// Largest value of a u (1 - u)^2 + b u^2 (1 - u) on [0, 1], for a, b >= 0.
//   The derivative vanishes where 3 (a - b) u^2 - 2 (2a - b) u + a = 0, written so that nothing cancels: from the end with
//   the larger slope.
float bump_height(float a, float b) {
    float larger = max(a, b);
    if (larger == 0.0) return 0.0;
    float share = min(a, b) / larger;
    float u = 1.0 / (2.0 - share + sqrt(1.0 - share + share * share));
    return larger * u * (1.0 - u) * (1.0 - u + share * u);
}

// Cubic Hermite interpolant at `u`, not kept in the band.
float segment_curve(float front, float back, vec2 slopes, float u) {
    float rise = back - front;
    float square = 3.0 * rise - 2.0 * slopes.x - slopes.y;
    float cube = slopes.x + slopes.y - 2.0 * rise;
    return front + u * (slopes.x + u * (square + u * cube));
}

// How far the cubic from 0 to 1 with slopes a, b >= 0 leaves [0, 1]; 0 where a^2 + b^2 <= 9 (Fritsch and Carlson).
float overshoot(float a, float b) {
    if (a * a + b * b <= 9.0) return 0.0;
    float half_linear = 3.0 - 2.0 * a - b;
    float square = 3.0 * (a + b - 2.0);
    float discriminant = half_linear * half_linear - a * square;
    if (discriminant <= 0.0) return 0.0;
    float root = sqrt(discriminant);
    float high = a / (root - half_linear);
    float low = (root - half_linear) / square;
    vec2 slopes = vec2(a, b);
    return max(max(segment_curve(0.0, 1.0, slopes, high) - 1.0, -segment_curve(0.0, 1.0, slopes, low)), 0.0);
}

// Slopes of a segment between two crossings (positions 0 or 1) that keep its cubic in the band: both times one factor.
//   A bump between two crossings of one isovalue is scaled to the band. Between two isovalues the slopes are limited to
//   a^2 + b^2 <= 9, by so much as the cubic leaves the band: all the way where that is 2 % of the band.
vec2 limit_slopes(float front, float back, vec2 slopes) {
    vec2 size = min(abs(slopes), 1e9);   // beyond, the factor would round to nothing: squares stay finite
    slopes = sign(slopes) * size;
    if (front == back) return slopes / max(bump_height(size.x, size.y), 1.0);
    float far = clamp((overshoot(size.x, size.y) - SEGMENT_LEAVES) / SEGMENT_LEAVES_FAR, 0.0, 1.0);
    return slopes * mix(1.0, 3.0 / max(length(size), 3.0), far);
}

// Position in the band at the part `u` of the segment, in [0, 1].
float segment_position(float front, float back, vec2 slopes, float u) {
    return clamp(segment_curve(front, back, slopes, u), 0.0, 1.0);
}

// Number of panels for the largest optical depth that a segment can have; two at least for a bump: position times
// extinction is of degree 6 in u, one above what three nodes integrate exactly, and a bump's slopes are large.
int panel_count(float front, float back, float thickness) {
    float least = front == back ? 2.0 : 1.0;
    return int(clamp(ceil(thickness / SEGMENT_PANEL_DEPTH), least, float(MAX_SEGMENT_PANELS)));
}

// End of the first `number` of `count` panels, in [0, 1]: even, unless the segment is so thick that even panels would be
// too deep; then finer towards the front, where the light comes from.
float panel_edge(int number, int count, float thickness) {
    float even = float(number) / float(count);
    return thickness > SEGMENT_PANEL_DEPTH * float(MAX_SEGMENT_PANELS) ? even * even : even;
}

// Largest extinction times length that the cubic reaches: it stays between its Bernstein coefficients, so that a shallow
// bump needs few panels, however dense the far end of its band.
float largest_depth(vec2 depths, float front, float back, vec2 slopes) {
    vec4 reached = clamp(vec4(front, front + slopes.x / 3.0, back - slopes.y / 3.0, back), 0.0, 1.0);
    float lowest = min(min(reached.x, reached.y), min(reached.z, reached.w));
    float highest = max(max(reached.x, reached.y), max(reached.z, reached.w));
    return max(mix(depths.x, depths.y, lowest), mix(depths.x, depths.y, highest));
}

// Three Gauss-Legendre nodes of a piece of a segment, in which the optical depth is small.
struct Panel {
    vec3 parts;                           // of the segment
    vec3 positions;                       // in the band
    vec3 emitted;                         // in proportion to what is seen of each node
    float total;                          // their sum
    float opacity;                        // of the piece, in closed form: the rule is exact for extinction, a cubic
};

// The piece of a segment from the part `start` on; `depths` is the extinction at the two ends of the band times the length
// of the whole segment. The depth before a node is by the matrix of Gauss's method of order 6.
Panel segment_panel(vec2 depths, float front, float back, vec2 slopes, float start, float length) {
    vec3 u = start + length * SEGMENT_NODES;
    vec3 p = vec3(segment_position(front, back, slopes, u.x), segment_position(front, back, slopes, u.y),
                  segment_position(front, back, slopes, u.z));
    vec3 x = length * mix(vec3(depths.x), vec3(depths.y), p);
    vec3 before = vec3(dot(SEGMENT_BEFORE_FIRST, x), dot(SEGMENT_BEFORE_SECOND, x), dot(SEGMENT_BEFORE_THIRD, x));
    vec3 emitted = SEGMENT_WEIGHTS * x * exp(min(min(before.x, before.y), before.z) - before);
    return Panel(u, p, emitted, emitted.x + emitted.y + emitted.z, opacity_from_depth(dot(SEGMENT_WEIGHTS, x)));
}

// Emission integrals over the part [part.x, part.y] of a segment, along which the position p in the band is a cubic of u:
// integrals of w tau exp(-D) for w = 1, p, u and u p. A colour that runs linearly over the band gives
// c_low (x - y) + c_high y.
//   Panels of optical depth 1 at most; the weights of their nodes are scaled to sum to the opacity.
// Error of rounding: see tests/shaders/test_segment.py.
vec4 cubic_moments(vec2 depths, float front, float back, vec2 slopes, vec2 part) {
    float width = part.y - part.x;
    float thickness = largest_depth(depths, front, back, slopes) * width;
    int count = panel_count(front, back, thickness);
    vec4 moments = vec4(0.0);
    float through = 1.0;
    float left = 0.0;
    int number = 0;
    do {
        float right = panel_edge(number + 1, count, thickness);
        Panel panel = segment_panel(depths, front, back, slopes, part.x + width * left, width * (right - left));
        if (panel.total > 0.0) {
            vec4 seen = vec4(panel.total, dot(panel.emitted, panel.positions), dot(panel.emitted, panel.parts),
                             dot(panel.emitted, panel.parts * panel.positions));
            moments += through * panel.opacity / panel.total * seen;
            through *= 1.0 - panel.opacity;
        }
        left = right;
        ++number;
    } while (number < count && through >= SEGMENT_SPENT);
    return moments;
}
