// Pre-integration without a table: the field runs linearly along the stretch, and is followed band by band: exact for such a
// field. Isosurfaces are composited where the field takes their value, if they are asked for.

void composite_bands(Stretch stretch, bool surfaces) {
    int band = band_of(stretch.front);
    int last = band_of(stretch.back);
    if (band == last && bands[band].extinction_max == 0.0) return;
    bool rising = stretch.back > stretch.front;
    float inverse_rise = stretch.back == stretch.front ? 0.0 : 1.0 / (stretch.back - stretch.front);
    float length = stretch.end - stretch.start;
    float start = stretch.start;
    float front = stretch.front;
    while (true) {
        bool ends = band == last;
        float back = ends ? stretch.back : rising ? bands[band].value_high : bands[band].value_low;
        float end = ends ? stretch.end : stretch.start + length * clamp((back - stretch.front) * inverse_rise, 0.0, 1.0);
        if (bands[band].extinction_max > 0.0) {
            float way = ends && inverse_rise == 0.0 ? length : length * abs((back - front) * inverse_rise);
            composite_slab(start, way, end, optics_in(band, front), optics_in(band, back));
        }
        if (ends) break;
        if (surfaces) composite_surface(end, levels[rising ? band : band - 1].impulse);
        band += rising ? 1 : -1;
        start = end;
        front = back;
    }
}
