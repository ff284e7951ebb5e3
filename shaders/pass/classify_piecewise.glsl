// Pre-integration without a table: the field runs linearly along the stretch, and is followed band by band: exact for such a
// field. Isosurfaces are composited where the field takes their value, if they are asked for.

// Where a value lies in the transfer function.
struct ValuePlace {
    vec4 bin;
    int band;
};

ValuePlace front_place;                   // of the two samples that `meet` has met last
ValuePlace back_place;

ValuePlace place_of(float value) {
    vec4 bin = bin_of(value);
    return ValuePlace(bin, band_in(bin, value));
}

void composite_bands(Stretch stretch, ValuePlace near, ValuePlace far, bool surfaces) {
    bool same = near.bin.x == far.bin.y && near.bin.y == far.bin.x;
    if (same && near.bin.z == 0.0) return;
    int band = near.band;
    int last = far.band;
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
        if (SURFACES == 1 && surfaces) composite_surface(end, band_texel(rising ? band : band - 1, TEXEL_IMPULSE));
        band += rising ? 1 : -1;
        start = end;
        front = back;
    }
}
