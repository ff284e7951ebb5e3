// Post-classification: the transfer function at the samples. What lies between two samples is not seen, isosurfaces least.
// Source: Levoy 1990; Knoll et al. 2009, eqs. 2-4.

vec4 front_optics;                        // at the two samples that `meet` has met last
vec4 back_optics;

// QUADRATURE 0: the sample at the front stands for the stretch; 1: extinction and colour run linearly to its end.
void composite_samples(Stretch stretch) {
#if QUADRATURE
    composite_slab(stretch.start, stretch.end - stretch.start, stretch.end, front_optics, back_optics);
#else
    float opacity = opacity_from_depth(front_optics.a * (stretch.end - stretch.start));
    if (opacity > 0.0) composite(opacity * lit(front_optics.rgb, stretch.start), opacity);
#endif
}
