// Pre-integration by the integrals of emission and extinction over the value, of which one row of a table is enough for stretches
// of any length: the mean of both along a stretch is the difference of the integrals over that of the values. The opacity is that
// of the exact integral; the colour is the mean one, whether it is met in front or behind.
// Source: Engel et al. 2001, section 4.4 (self-attenuation within a stretch neglected). Twin: isosample/transfer/preintegration.py

#if METHOD == 1 && INTEGRATION == 3
layout(binding = UNIT_PRE_INTEGRATION) uniform sampler2D integrals;

const int INTEGRAL_CELLS = INTEGRAL_ROWS * BAND_START_COUNT / 3;

// A value, the integrals of premultiplied colour and extinction up to it, and their means over its cell of the table. The integral
// up to the cell is apart from what a float loses of it and what the cell adds: small differences of large integrals stay exact.
struct Known {
    float value;
    vec4 integral;
    vec4 rest;
    vec4 mean;
};

Known known_front;                        // of the two samples that `meet` has met last
Known known_back;

Known known_at(float value) {
    float shown = clamp(value, 0.0, 1.0);
    int cell = min(int(shown * float(INTEGRAL_CELLS)), INTEGRAL_CELLS - 1);
    vec2 place = vec2(float(cell % BAND_START_COUNT) + 0.5, float(cell / BAND_START_COUNT) + 0.5) / vec2(BAND_START_COUNT, INTEGRAL_ROWS);
    vec4 before = textureLod(integrals, place, 0.0);
    vec4 lost = textureLod(integrals, place + vec2(0.0, 1.0 / 3.0), 0.0);
    vec4 mean = textureLod(integrals, place + vec2(0.0, 2.0 / 3.0), 0.0);
    mean = shown > 0.0 ? mean : raycast.lowest;             // much of a volume may have this value: air at the foot of a ramp is empty
    return Known(shown, before, lost + (shown - float(cell) / float(INTEGRAL_CELLS)) * mean, mean);
}

void composite_means(Stretch stretch) {
    float rise = known_back.value - known_front.value;
    bool steep = abs(rise) * float(INTEGRAL_CELLS) > 1.0;   // else the difference would be that of its roundings
    precise vec4 difference = (known_back.integral - known_front.integral) + (known_back.rest - known_front.rest);
    vec4 mean = steep ? difference / (steep ? rise : 1.0) : 0.5 * (known_front.mean + known_back.mean);
    if (!(mean.a > 0.0)) return;
    float opacity = opacity_from_depth(mean.a * (stretch.end - stretch.start));
    vec3 color = mean.rgb / mean.a;
#if SHADING
    color = lit(color, 0.5 * (stretch.start + stretch.end));
#endif
    composite(opacity * color, opacity);
}
#endif
