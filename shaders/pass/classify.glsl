// What a stretch of a ray adds to it: composite_stretch of the chosen METHOD. Every file is included once, whatever the
// constants; a method's own file defines nothing but for its method.

#include "pass/classify_parts.glsl"
#include "pass/classify_post.glsl"
#include "pass/classify_piecewise.glsl"
#include "pass/classify_table.glsl"
#include "pass/classify_integral.glsl"
#include "pass/classify_peaks.glsl"

// Looks a sample's value up: what the samples before it met moves from the back of a stretch to the front of the next one.
void meet(float value) {
#if METHOD == 1 && INTEGRATION == 0
    front_place = back_place;
    back_place = place_of(value);
#elif METHOD == 1 && INTEGRATION == 3
    known_front = known_back;
    known_back = known_at(value);
#elif METHOD != 1
    front_optics = back_optics;
    back_optics = optics_at(value);
#endif
}

// The stretch between the two samples met last.
void composite_stretch(Stretch stretch) {
#if METHOD == 0
    composite_samples(stretch);
#elif METHOD == 1 && INTEGRATION == 0
    composite_bands(stretch, front_place, back_place, true);
#elif METHOD == 1 && INTEGRATION == 3
    composite_means(stretch);
#elif METHOD == 1
    composite_entry(stretch);
#else
    composite_peaks(stretch);
#endif
}
