// Where a crossing was that the lists have lost. Expects pass/tables.glsl, `frame` and `walk`, and lib/segment.glsl.
// Twin: isosample/integral/list_walk.py

const int GAP_BISECTIONS = 24;             // of a gap: below the rounding of float32

// One end of the gap in which a crossing was lost: distance, normalised value, df/dt or UNKNOWN_SLOPE.
struct GapEnd {
    float distance;
    float value;
    float slope;
};

bool without_extinction(int band) { return band_at(clamp(band, 0, frame.level_count)).extinction_max == 0.0; }

bool has_slope(GapEnd end) { return end.slope != UNKNOWN_SLOPE; }

// Part of a gap at which its Hermite cubic goes through a value, in a direction (1 up, -1 down).
float part_at(float value, float sign, GapEnd front, GapEnd back) {
    vec2 slopes = (back.distance - front.distance) * vec2(front.slope, back.slope);
    float low = 0.0;
    float high = 1.0;
    for (int i = 0; i < GAP_BISECTIONS; ++i) {
        float middle = 0.5 * (low + high);
        if (sign * (segment_curve(front.value, back.value, slopes, middle) - value) < 0.0) low = middle;
        else high = middle;
    }
    return 0.5 * (low + high);
}

// Place of a lost crossing of `level`. From an invisible band, or into one, the slope of the visible side tells it; else
// the cubic of the gap, or the straight line where a slope is not known. `walk.unplaced` counts what is a mere guess.
float place_of(int level, bool upwards, GapEnd front, GapEnd back) {
    float value = band_at(level).value_high;
    float sign = upwards ? 1.0 : -1.0;
    bool known = has_slope(front) && has_slope(back);
    bool starts_before = sign * (front.value - value) < 0.0 || (front.value == value && sign * front.slope < 0.0);
    bool ends_beyond = sign * (back.value - value) > 0.0 || (back.value == value && sign * back.slope < 0.0);
    float place;
    bool certain = true;
    if (without_extinction(upwards ? level : level + 1) && back.value != value && has_slope(back) && back.slope != 0.0) {
        place = back.distance - abs(back.value - value) / abs(back.slope);
        certain = place >= front.distance - frame.reach;
    } else if (without_extinction(upwards ? level + 1 : level) && front.value != value && has_slope(front)
               && front.slope != 0.0) {
        place = front.distance + abs(value - front.value) / abs(front.slope);
        certain = place <= back.distance + frame.reach;
    } else if (known && starts_before && ends_beyond) {
        place = mix(front.distance, back.distance, part_at(value, sign, front, back));
        certain = !(front.value == value && back.value == value);
    } else if (front.value != back.value && value >= min(front.value, back.value) && value <= max(front.value, back.value)) {
        place = mix(front.distance, back.distance, (value - front.value) / (back.value - front.value));
        certain = value != front.value && value != back.value;
    } else {
        float total = known ? abs(front.slope) + abs(back.slope) : 0.0;
        place = mix(front.distance, back.distance, total > 0.0 ? abs(front.slope) / total : 0.5);
        certain = false;
    }
    if (!certain) ++walk.unplaced;
    return clamp(place, walk.distance, max(walk.distance, back.distance));
}
