// Peak finding: where a stretch takes the value of a peak of the transfer function, the ray is classified at that value.
// Source: Knoll et al. 2009, section 4 and Algorithm 1. Constants: PEAK_MODE (0 samples and peaks, 1 peaks in place of
// samples, 2 peaks alone, 3 samples alone), PEAK_WEIGHT (0 extinction over a length of 1, 1 share of the integral),
// CROSSINGS (0 secant, 1 exact).

#include "pass/peaks_secant.glsl"
#include "pass/peaks_exact.glsl"

#if METHOD == 2
void composite_peaks(Stretch stretch) {
#if PEAK_MODE == 3
    composite_samples(stretch);
#elif PEAK_WEIGHT == 1 && CROSSINGS == 1
    composite_cells(stretch);
#elif PEAK_WEIGHT == 1
    composite_shares(stretch);
#else
#if CROSSINGS == 1
    bool found = composite_cells(stretch);
#else
    bool found = composite_crossings(stretch);
#endif
    if (PEAK_MODE == 0 || (PEAK_MODE == 1 && !found)) composite_samples(stretch);
#endif
}
#endif
