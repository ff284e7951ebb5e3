// Values inside one band, between two neighbouring isovalues.
// Twin: isosample/integral/bands.py

// Position of a normalised value in a band: 0 at its lower end, 1 at its upper end. `inverse_width` is 0 for an empty
// band. Values beside the band (a face value that the surfaces overrule) take the nearer end.
float band_position(float value_low, float inverse_width, float value) {
    return clamp((value - value_low) * inverse_width, 0.0, 1.0);
}
