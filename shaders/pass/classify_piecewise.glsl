// Pre-integration without a table: the field runs linearly along the stretch, and is followed band by band: exact for such a
// field. Isosurfaces are composited where the field takes their value.

void composite_linear(Stretch stretch) {
    int band = band_of(stretch.front);
    int last = band_of(stretch.back);
    if (band == last && bands[band].extinction_max == 0.0) return;
    bool rising = stretch.back > stretch.front;
    float inverse_rise = stretch.back == stretch.front ? 0.0 : 1.0 / (stretch.back - stretch.front);
    float length = stretch.end - stretch.start;
    float start = stretch.start;
    float front = stretch.front;
    while (band != last) {
        float level = rising ? bands[band].value_high : bands[band].value_low;
        float end = stretch.start + length * clamp((level - stretch.front) * inverse_rise, 0.0, 1.0);
        if (bands[band].extinction_max > 0.0) composite_slab(start, end, optics_in(band, front), optics_in(band, level));
        composite_surface(end, levels[rising ? band : band - 1].impulse);
        band += rising ? 1 : -1;
        start = end;
        front = level;
    }
    if (bands[band].extinction_max > 0.0) {
        composite_slab(start, stretch.end, optics_in(band, front), optics_in(band, stretch.back));
    }
}
