// Post-classification: the transfer function at the samples. What lies between two samples is not seen, isosurfaces least.
// Source: Levoy 1990; Knoll et al. 2009, eqs. 2-4.

// QUADRATURE 0: the sample at the front stands for the stretch; 1: extinction and colour run linearly to its end.
void composite_samples(Stretch stretch) {
    vec4 front = optics_at(stretch.front);
#if QUADRATURE
    composite_slab(stretch.start, stretch.end - stretch.start, stretch.end, front, optics_at(stretch.back));
#else
    float opacity = opacity_from_depth(front.a * (stretch.end - stretch.start));
    if (opacity > 0.0) composite(opacity * lit(front.rgb, stretch.start), opacity);
#endif
}
