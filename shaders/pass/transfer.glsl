// The transfer function at a normalised value. Expects `bands`, `band_starts`, `raycast` and the constant TRANSFER.

#if TRANSFER
layout(binding = UNIT_TRANSFER) uniform sampler2D transfer; // one row over the values [0, 1]
#endif

// Band that holds a value; one equal to a level belongs to the band above. Bisects what its bin leaves open.
int band_of(float value) {
    int bin = int(clamp(value * float(BAND_START_COUNT), 0.0, float(BAND_START_COUNT - 1)));
    int low = int(band_starts[bin]);
    int high = int(band_starts[bin + 1]);
    while (low < high) {
        int middle = (low + high) / 2;
        bool above = value >= bands[middle].value_high;
        low = above ? middle + 1 : low;
        high = above ? high : middle;
    }
    return low;
}

// Straight linear RGB and extinction [1/world] at a value of a band (or at its end).
vec4 optics_in(int band, float value) {
    return mix(bands[band].low, bands[band].high, band_position(bands[band].value_low, bands[band].inverse_width, value));
}

// The same at any value.
vec4 optics_at(float value) {
#if TRANSFER
    float entry = clamp(value, 0.0, 1.0) * float(raycast.transfer_size - 1);
    int below = min(int(entry), raycast.transfer_size - 2);
    return mix(texelFetch(transfer, ivec2(below, 0), 0), texelFetch(transfer, ivec2(below + 1, 0), 0), entry - float(below));
#else
    return optics_in(band_of(value), value);
#endif
}
