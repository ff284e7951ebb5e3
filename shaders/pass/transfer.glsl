// The transfer function, from one texture: its first row has BAND_START_COUNT bins of the values [0, 1] (first and last band of
// a bin, largest extinction in these); then, with TRANSFER 1, rows of the sampled function; then bands of BAND_TEXELS texels
// each. Texels take software renderers less time than storage buffers.
// Made by isosample/rendering/transfer_texture.py.

layout(binding = UNIT_TRANSFER) uniform sampler2D transfer;

const int FIRST_BAND_ROW = TRANSFER == 1 ? 1 + SAMPLED_ROWS : 1;

vec2 transfer_size = vec2(textureSize(transfer, 0));   // computed once per call of the shader

// A texel by its number: the nearest to its middle, for which llvmpipe takes half the instructions of texelFetch.
vec4 transfer_texel(ivec2 texel) { return textureLod(transfer, (vec2(texel) + 0.5) / transfer_size, 0.0); }

vec4 band_texel(int band, int texel) {
    int place = band * BAND_TEXELS + texel;
    return transfer_texel(ivec2(place % BAND_START_COUNT, FIRST_BAND_ROW + place / BAND_START_COUNT));
}

vec4 bin_of(float value) {
    return transfer_texel(ivec2(clamp(value * float(BAND_START_COUNT), 0.0, float(BAND_START_COUNT - 1)), 0));
}

// Band of a bin that holds a value; one equal to a level belongs to the band above.
int band_in(vec4 bin, float value) {
#if FEW_BANDS
    return value >= bin.w ? int(bin.y) : int(bin.x);
#else
    int low = int(bin.x);
    int high = int(bin.y);
    if (low < high) {
        do {
            int middle = (low + high) / 2;
            bool above = value >= band_texel(middle, TEXEL_RANGE).y;
            low = above ? middle + 1 : low;
            high = above ? high : middle;
        } while (low < high);
    }
    return low;
#endif
}

int band_of(float value) { return band_in(bin_of(value), value); }

// Straight linear RGB and extinction [1/world] at a value of a band (or at its end), whose range is given.
vec4 optics_in(int band, vec4 range, float value) {
    return mix(band_texel(band, TEXEL_OPTICS_LOW), band_texel(band, TEXEL_OPTICS_HIGH), band_position(range.x, range.w, value));
}

// The same at any value.
vec4 optics_at(float value) {
#if TRANSFER
    float entry = clamp(value, 0.0, 1.0) * float(SAMPLED_ROWS * BAND_START_COUNT - 1);
    int below = min(int(entry), SAMPLED_ROWS * BAND_START_COUNT - 2);
    ivec2 places = ivec2(below, below + 1);
    ivec2 rows = places / BAND_START_COUNT;
    places -= rows * BAND_START_COUNT;
    return mix(transfer_texel(ivec2(places.x, rows.x + 1)), transfer_texel(ivec2(places.y, rows.y + 1)),
               entry - float(below));
#else
    int band = band_of(value);
    return optics_in(band, band_texel(band, TEXEL_RANGE), value);
#endif
}
