// Pre-integration without a table: the field runs linearly along the stretch, and is followed band by band: exact for such a
// field. Isosurfaces are composited where the field takes their value, if they are asked for.

void composite_bands(Stretch stretch, bool surfaces) {
    vec4 front_bin = bin_of(stretch.front);
    vec4 back_bin = bin_of(stretch.back);
    bool same = front_bin.x == back_bin.y && front_bin.y == back_bin.x;
    if (same && front_bin.z == 0.0) return;
    int band = band_in(front_bin, stretch.front);
    int last = band_in(back_bin, stretch.back);
    bool rising = stretch.back > stretch.front;
    float inverse_rise = stretch.back == stretch.front ? 0.0 : 1.0 / (stretch.back - stretch.front);
    float length = stretch.end - stretch.start;
    float start = stretch.start;
    float front = stretch.front;
    while (true) {
        spent_loops += 2;                 // this one's and that of segment_weights
        vec4 range = band_texel(band, TEXEL_RANGE);
        bool ends = band == last;
        float back = ends ? stretch.back : rising ? range.y : range.x;
        float end = ends ? stretch.end : stretch.start + length * clamp((back - stretch.front) * inverse_rise, 0.0, 1.0);
        if (range.z > 0.0) {
            vec4 low = band_texel(band, TEXEL_OPTICS_LOW);
            vec4 high = band_texel(band, TEXEL_OPTICS_HIGH);
            float way = inverse_rise == 0.0 ? length : length * abs((back - front) * inverse_rise);
            composite_slab(start, way, end, mix(low, high, band_position(range.x, range.w, front)),
                           mix(low, high, band_position(range.x, range.w, back)));
        }
        if (ends) break;
        if (surfaces) composite_surface(end, band_texel(rising ? band : band - 1, TEXEL_IMPULSE));
        band += rising ? 1 : -1;
        start = end;
        front = back;
    }
}
