// The emission integral over a segment that is lit, with the gradient running linearly from one end to the other.
// Expects lib/segment.glsl and lib/shading.glsl.
// Source: cubic Hermite interpolation, see lib/segment.glsl; Blinn 1977, see lib/shading.glsl.
// Twin: isosample/integral/lit_segment.py

const float LEAST_COSINE = 0.02;         // of a gradient to the ray, where its length is told from the slope along the ray

// Gradient at a crossing, from its unit normal and |df/dt| there: the slope along the ray is the gradient's part along it.
//   Where the ray passes along the surface the slope tells little of the length; it is then taken for shorter.
vec3 crossing_gradient(vec3 normal, float slope, vec3 direction) {
    return normal * (abs(slope) / max(abs(dot(normal, direction)), LEAST_COSINE));
}

// Integrals of w tau exp(-D) over a part of a segment as cubic_moments has them, for w = 1, s, s p and h: p is the position
// in the band, s c + h what light makes of a colour c. A colour that runs linearly over the band gives
// c_low (y - z) + c_high z + w.
//   The normal at a node is that of the gradients at the two ends, mixed: where the value turns, at the middle of a hump,
//   the ray passes along the isosurface and the light goes down there, which it does not between its two ends.
// Error of rounding: see tests/shaders/test_lit_segment.py.
vec4 lit_moments(vec2 depths, float front, float back, vec2 slopes, vec2 part, vec3 front_gradient, vec3 back_gradient,
                 vec3 direction, vec4 material) {
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
            vec3 shade;
            vec3 highlight;
            for (int node = 0; node < 3; ++node) {
                vec3 gradient = mix(front_gradient, back_gradient, panel.parts[node]);
                float steepness = length(gradient);
                vec3 normal = steepness > 0.0 ? gradient / steepness : vec3(0.0);
                vec3 lit = blinn_phong(vec3(1.0, 0.0, 0.0), normal, direction, material);
                shade[node] = lit.x - lit.y;
                highlight[node] = lit.y;
            }
            vec4 seen = vec4(panel.total, dot(panel.emitted, shade), dot(panel.emitted, shade * panel.positions),
                             dot(panel.emitted, highlight));
            moments += through * panel.opacity / panel.total * seen;
            through *= 1.0 - panel.opacity;
        }
        left = right;
        ++number;
    } while (number < count && through >= SEGMENT_SPENT);
    return moments;
}
