// The state of one ray between two crossings, and what a segment, a sheet and an impulse add to it. Expects
// pass/tables.glsl, `frame`, `ray_direction`, and the constants SEGMENT_RULE and SHADING.
// Twins: isosample/integral/list_segments.py, list_walk.py

const float UNKNOWN_SLOPE = 3e38;
const vec4 UNLIT = vec4(1.0, 0.0, 0.0, 1.0);  // a material that leaves colours as they are

struct Walk {
    vec3 radiance;                        // premultiplied, in front of the current position
    float transmittance;
    float visible_start, visible_end;     // the part of the ray that is not cut away [world]
    float distance;                       // front end of the current segment [world]
    float position;                       // and the value there as a position in its band: 0 lower end, 1 upper end
    float slope;                          // and df/dt there [normalised / world], or UNKNOWN_SLOPE
    int band;                             // band of the segment; in a balanced span it may leave 0 ... level_count
    bool inside;                          // inside the volume (or the valid cells)
    bool balanced;                        // the crossings of this span add up, see weigh_span
    bool leave_by_value;                  // the exit's value, not the surfaces, tells in which band the ray leaves
    int ahead;                            // bands by which crossings came too soon, see band_at
    int debt;                             // falling less rising crossings that were passed over, see passes_over
    uint normal;                          // packed normal at the front end, or NO_NORMAL
    uint violations, reordered, unplaced, saturated;
};

Walk walk;

Walk fresh_walk() {
    return Walk(vec3(0.0), 1.0, 0.0, 0.0, 0.0, 0.0, UNKNOWN_SLOPE, 0, false, false, false, 0, 0, NO_NORMAL, 0u, 0u, 0u, 0u);
}

// Whether one of two ends of a segment has a normal at least.
bool has_normal(uint front, uint back) { return front != NO_NORMAL || back != NO_NORMAL; }

// Normal at a part of the way between two crossings, so that the light does not jump where a cut passes a crossing; that
// of the other end where one has none. Zero where both have none, or where the two cancel.
vec3 normal_between(uint front, uint back, float part) {
#if SHADING
    vec3 first = unpack_normal(front != NO_NORMAL ? front : back);
    vec3 last = unpack_normal(back != NO_NORMAL ? back : front);
    vec3 mixed = has_normal(front, back) ? mix(first, last, part) : vec3(0.0);
    return mixed / max(length(mixed), 1e-6);
#else
    return vec3(0.0);
#endif
}

// Colour lit by a normal, or as it is without one.
vec3 lit(vec3 straight, vec3 normal) {
#if SHADING
    if (normal != vec3(0.0)) return blinn_phong(straight, normal, ray_direction, frame.material);
#endif
    return straight;
}

void composite(vec3 premultiplied, float opacity) {
    walk.radiance += walk.transmittance * premultiplied;
    walk.transmittance *= 1.0 - opacity;
}

Band current_band() { return band_at(clamp(walk.band, 0, frame.level_count)); }

// Extinction and colour at the front of the segment hold up to its end.
void composite_constant(Band band, float length, vec3 front_normal) {
    vec4 front = mix(band.low, band.high, walk.position);
    float depth = front.a * length;
#if SEGMENT_RULE == 1
    if (depth > 1.0) ++walk.saturated;
    float opacity = min(depth, 1.0);
#else
    float opacity = opacity_from_depth(depth);
#endif
    composite(opacity * lit(front.rgb, front_normal), opacity);
}

// Extinction and colour run linearly; `part` is the visible part of the segment.
void composite_linear(Band band, float position, vec2 part, float length, uint normal) {
    vec4 front = mix(band.low, band.high, mix(walk.position, position, part.x));
    vec4 back = mix(band.low, band.high, mix(walk.position, position, part.y));
    vec2 weights = segment_weights(front.a * length, back.a * length);
    composite(weights.x * lit(front.rgb, normal_between(walk.normal, normal, part.x))
              + weights.y * lit(back.rgb, normal_between(walk.normal, normal, part.y)), weights.x + weights.y);
}

// The value runs along a cubic, with the slope of the chord where an end has none; the gradient, for the light, runs
// linearly from one end of the segment to the other.
void composite_cubic(Band band, float span, float position, float slope, vec2 part, uint normal) {
    float rise = position - walk.position;
    bool crossings = walk.slope != UNKNOWN_SLOPE && slope != UNKNOWN_SLOPE;
    vec2 slopes = vec2(walk.slope != UNKNOWN_SLOPE ? walk.slope * span * band.inverse_width : rise,
                       slope != UNKNOWN_SLOPE ? slope * span * band.inverse_width : rise);
    if (crossings) slopes = limit_slopes(walk.position, position, slopes);
    vec2 depths = span * vec2(band.low.a, band.high.a);
#if SHADING
    vec3 front_gradient = normal_between(walk.normal, normal, 0.0);
    vec3 back_gradient = normal_between(walk.normal, normal, 1.0);
    if (crossings) {
        front_gradient = crossing_gradient(front_gradient, walk.slope, ray_direction);
        back_gradient = crossing_gradient(back_gradient, slope, ray_direction);
    }
    vec4 material = has_normal(walk.normal, normal) ? frame.material : UNLIT;
    vec4 moments = lit_moments(depths, walk.position, position, slopes, part, front_gradient, back_gradient, ray_direction,
                               material);
    composite(band.low.rgb * (moments.y - moments.z) + band.high.rgb * moments.z + moments.w, moments.x);
#else
    vec4 moments = cubic_moments(depths, walk.position, position, slopes, part);
    composite(band.low.rgb * (moments.x - moments.y) + band.high.rgb * moments.y, moments.x);
#endif
}

// Composites the segment up to `distance`, where the value is at `position` of the current band with the slope df/dt (or
// UNKNOWN_SLOPE), and moves there.
void advance(float distance, float position, float slope, uint normal) {
#if EXTINCTION
    Band band = current_band();
    float start = max(walk.distance, walk.visible_start);
    float end = min(distance, walk.visible_end);
    if (band.extinction_max > 0.0 && end > start) {
        float span = distance - walk.distance;
        vec2 part = vec2(start - walk.distance, end - walk.distance) / span;
#if SEGMENT_RULE == 3
        composite_cubic(band, span, position, slope, part, normal);
#elif SEGMENT_RULE == 2
        composite_linear(band, position, part, end - start, normal);
#else
        composite_constant(band, end - start, normal_between(walk.normal, normal, part.x));
#endif
    }
#endif
    walk.distance = distance;
    walk.position = position;
    walk.slope = slope;
    walk.normal = normal;
}

// Composites what there is on the isovalue itself: first the thin peak, opacity 1 - exp(-area / |df/dt|), then the impulse.
// `slope` is |df/dt| [normalised / world].
void composite_level(int level, float slope, uint normal) {
#if LEVEL_LIGHT
    Level here = level_at(level);
    if (here.impulse.a == 0.0 && here.sheet.a == 0.0) return;
    if (walk.distance < walk.visible_start || walk.distance > walk.visible_end) return;
    vec3 light = normal_between(normal, normal, 0.0);
#if LEVEL_LIGHT > 1
    float sheet = opacity_from_depth(here.sheet.a / max(slope, LEAST_SHEET_SLOPE / frame.box_radius));
    composite(sheet * lit(here.sheet.rgb, light), sheet);
#endif
    composite(here.impulse.a * lit(here.impulse.rgb, light), here.impulse.a);
#endif
}
