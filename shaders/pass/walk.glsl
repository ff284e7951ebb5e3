// The state of one ray between two crossings, and what a segment and an impulse add to it. Expects the buffers `bands` and
// `impulses`, `frame`, `ray_direction`, and the constants SEGMENT_RULE and SHADING. Twin: isosample/integral/data_centric.py

struct Walk {
    vec3 radiance;                        // premultiplied, in front of the current position
    float transmittance;
    float visible_start, visible_end;     // the part of the ray that is not cut away [world]
    float distance;                       // front end of the current segment [world]
    float position;                       // and the value there as a position in its band: 0 lower end, 1 upper end
    int band;                             // band of the segment; in a balanced span it may leave 0 ... level_count
    bool inside;                          // inside the volume (or the valid cells)
    bool balanced;                        // the crossings of this span add up, see weigh_span
    bool leave_by_value;                  // the exit's value, not the surfaces, tells in which band the ray leaves
    uint normal;                          // packed normal at the front end; 0: none
    uint violations, reordered, saturated;
};

Walk walk;

// Normal at a part of the way between two crossings, so that the light does not jump where a cut passes a crossing; that
// of the other end where the box has none (0). Zero where both have none, or where the two cancel.
vec3 normal_between(uint front, uint back, float part) {
#if SHADING
    vec3 first = unpack_normal(front != 0u ? front : back);
    vec3 last = unpack_normal(back != 0u ? back : front);
    vec3 mixed = (front | back) != 0u ? mix(first, last, part) : vec3(0.0);
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

Band current_band() { return bands[clamp(walk.band, 0, frame.level_count)]; }

// Composites the segment up to `distance`, where the value is at `position` of the current band, and moves there.
void advance(float distance, float position, uint normal) {
    Band band = current_band();
    float start = max(walk.distance, walk.visible_start);
    float end = min(distance, walk.visible_end);
    if (band.extinction_max > 0.0 && end > start) {
        float span = distance - walk.distance;
        float length = end - start;
        float part = (start - walk.distance) / span;
        vec3 front_normal = normal_between(walk.normal, normal, part);
#if SEGMENT_RULE == 2
        float last_part = (end - walk.distance) / span;
        vec3 back_normal = normal_between(walk.normal, normal, last_part);
        vec4 front = mix(band.low, band.high, mix(walk.position, position, part));
        vec4 back = mix(band.low, band.high, mix(walk.position, position, last_part));
        vec2 weights = segment_weights(front.a * length, back.a * length);
        composite(weights.x * lit(front.rgb, front_normal) + weights.y * lit(back.rgb, back_normal),
                  weights.x + weights.y);
#else
        vec4 front = mix(band.low, band.high, walk.position);
        float depth = front.a * length;
#if SEGMENT_RULE == 1
        if (depth > 1.0) ++walk.saturated;
        float opacity = min(depth, 1.0);
#else
        float opacity = opacity_from_depth(depth);
#endif
        composite(opacity * lit(front.rgb, front_normal), opacity);
#endif
    }
    walk.distance = distance;
    walk.position = position;
    walk.normal = normal;
}

void composite_impulse(int level, uint normal) {
    vec4 impulse = impulses[level];
    if (impulse.a == 0.0 || walk.distance < walk.visible_start || walk.distance > walk.visible_end) return;
    composite(impulse.a * lit(impulse.rgb, normal_between(normal, normal, 0.0)), impulse.a);
}
