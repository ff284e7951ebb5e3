// What a stretch of a ray adds to it: composite_stretch of the chosen METHOD. Every file is included once, whatever the
// constants; a method's own file defines nothing but for its method.

#include "pass/classify_parts.glsl"
#include "pass/classify_post.glsl"
#include "pass/classify_piecewise.glsl"
#include "pass/classify_table.glsl"
#include "pass/classify_peaks.glsl"

void composite_stretch(Stretch stretch) {
#if METHOD == 0
    composite_samples(stretch);
#elif METHOD == 1 && INTEGRATION == 0
    composite_bands(stretch, true);
#elif METHOD == 1
    composite_entry(stretch);
#else
    composite_peaks(stretch);
#endif
}
