// Peaks between two samples, from a table, with the rule of signs and secant steps.

#if METHOD == 2 && CROSSINGS == 0
layout(binding = UNIT_PEAK_TABLE) uniform usampler2D peak_table;

int peak_bin(float value) {
    int bins = textureSize(peak_table, 0).x;
    return int(clamp(value * float(bins), 0.0, float(bins - 1)));
}

// Peaks that may lie in the stretch, in the order of the ray; NO_PEAK for none.
uvec4 peaks_between(float front, float back) {
    ivec2 bins = ivec2(peak_bin(front), peak_bin(back));
    uvec4 found = textureLod(peak_table, (vec2(bins) + 0.5) / vec2(textureSize(peak_table, 0)), 0.0);
    return bins.x == bins.y && back < front ? found.wzyx : found;
}

// Distance at which the field takes a value that its two ends enclose: the secant of eq. 5, kept between two points of
// either sign (regula falsi).
float secant_root(Stretch stretch, float value) {
    vec2 near = vec2(stretch.start, stretch.front - value);
    vec2 far = vec2(stretch.end, stretch.back - value);
    for (int i = 1; i < raycast.root_iterations; ++i) {
        ++spent_loops;
        float place = near.x - near.y * (far.x - near.x) / (far.y - near.y);
        vec2 between = vec2(place, ray_value(place) - value);
        if ((between.y < 0.0) == (near.y < 0.0)) near = between;
        else far = between;
    }
    return raycast.root_iterations == 0 ? far.x : near.x - near.y * (far.x - near.x) / (far.y - near.y);
}

// Whether the stretch goes through a value; one equal to the value is above it.
bool crosses(Stretch stretch, float value) { return (stretch.front < value) != (stretch.back < value); }

#if PEAK_WEIGHT == 0
// Peaks of the stretch; whether there was one.
bool composite_crossings(Stretch stretch) {
    uvec4 candidates = peaks_between(stretch.front, stretch.back);
    int found = 0;
    for (int i = 0; i < 4 && found < PEAKS; ++i) {
        if (candidates[i] == NO_PEAK) continue;
        float value = band_texel(int(candidates[i]), TEXEL_PEAK_PLACE).x;
        if (!crosses(stretch, value)) continue;
        ++found;
        composite_surface(secant_root(stretch, value), band_texel(int(candidates[i]), TEXEL_PEAK));
    }
    return found > 0;
}
#endif

#if PEAK_WEIGHT == 1
// The whole stretch: the field is linear between the samples and the peaks, so that every peak has the integral of the
// extinction over its share of the transfer function, divided by the slope.
void composite_shares(Stretch stretch) {
    uvec4 candidates = peaks_between(stretch.front, stretch.back);
    Stretch rest = stretch;
    int found = 0;
    for (int i = 0; i < 4 && found < PEAKS; ++i) {
        if (candidates[i] == NO_PEAK) continue;
        vec2 peak = band_texel(int(candidates[i]), TEXEL_PEAK_PLACE).xy;
        if (!crosses(stretch, peak.x)) continue;
        ++found;
        float place = clamp(secant_root(stretch, peak.x), rest.start, stretch.end);
        composite_bands(Stretch(rest.start, place, rest.front, peak.x), place_of(rest.front), place_of(peak.x), false);
        rest.start = place;
        rest.front = peak.x;
        if (peak.y > 0.0) composite_surface(place, band_texel(int(candidates[i]), TEXEL_PEAK));
        else ++ray.crossings;
    }
    if (PEAK_MODE != 2 || found > 0) composite_bands(rest, place_of(rest.front), place_of(rest.back), false);
}
#endif
#endif
