// Resolve pass, chains: lists in which every crossing leads on from the band into which the one before it led, from the band
// of the value where the ray enters the box to that of the value where it leaves. Almost all are; the others are left to
// pass/resolve.glsl, which makes the same of a chain, bit for bit, but takes longer: software renderers run every branch of a
// shader for all pixels.
// Expects the constants of pass/pixel.glsl, RUN and RUNS: how many runs of RUN nodes a list may have; and FACE_BAND: the band of all values
// on the faces of the box if nothing is visible in it, or -1.

#include "pass/pixel.glsl"
#include "pass/runs.glsl"

bool holds(int band, float value) {
    Band here = band_at(band);
    return (band == 0 || here.value_low <= value) && (band == frame.level_count || value < here.value_high);
}

// Values where a ray enters and leaves the box, and whether such a value lies in a band.
vec2 face_values(vec3 origin, vec2 inside) {
#if FACE_BAND >= 0
    return vec2(0.0);
#else
    return vec2(face_value(origin, inside.x).x, face_value(origin, inside.y).x);
#endif
}

bool borders(int band, float value) {
#if FACE_BAND >= 0
    return band == FACE_BAND;
#else
    return holds(band, value);
#endif
}

int border_band(float value) {
#if FACE_BAND >= 0
    return FACE_BAND;
#else
    return band_of(value);
#endif
}

#if RUNS > 0
// Where the present segment ends: at the crossing `node`, or where the ray leaves the box.
struct SegmentEnd {
    Node node;
    uint number;                          // of the crossing in the list; its length where the ray leaves
    float before;                         // distance of the crossing before
    bool leaving;
    bool broken;                          // the list is no chain
    float distance;                       // of the end, in the box and not in front of the segment's beginning [world]
};

// Whether nothing can be seen of the present segment and of the crossing at its end.
bool is_hidden() {
#if LEVEL_LIGHT
    return false;
#else
    return current_band().extinction_max == 0.0;
#endif
}

void look_at_end(inout SegmentEnd end, uint length, vec2 inside, vec2 values) {
    end.leaving = end.number == length;
    bool goes_on = end.leaving ? borders(walk.band, values.y)
                               : band_before(end.node) == walk.band && end.node.distance > end.before;
    end.broken = !goes_on;
    end.before = end.node.distance;
    end.distance = end.leaving ? inside.y : max(clamp(end.node.distance, inside.x, inside.y), walk.distance);
}

// Through the crossing at the end of the segment.
void pass_crossing(inout SegmentEnd end, uint length) {
    bool rising = is_rising(end.node);
    walk.band += rising ? 1 : -1;
    walk.position = rising ? 0.0 : 1.0;
    ++end.number;
    if (end.number < length) end.node = take_next();
}

// Slope at a crossing, along the ray.
float signed_slope(Node node) { return is_rising(node) ? node_slope(node) : -node_slope(node); }

// To the next segment of which something may be seen, or the last one.
void pass_hidden(inout SegmentEnd end, uint length, vec2 inside, vec2 values) {
    bool passes;
    do {
        look_at_end(end, length, inside, values);
        passes = !end.broken && !end.leaving && is_hidden();
        if (passes) {
            walk.distance = end.distance;
            walk.slope = signed_slope(end.node);
            walk.normal = end.node.normal;
            pass_crossing(end, length);
        }
    } while (passes);
}

// Walks along a ray that enters and leaves the box at the distances `inside`, with the values there; false if the list is no
// chain. Nodes at one distance make it none, as more than the distance decides their order.
//   Software renderers run the integral of a segment for all pixels of a packet as soon as one needs it: hence the loop inside
// the loop.
bool walk_chain(uint length, vec2 inside, vec2 values) {
    begin_merge(length);
    SegmentEnd end;
    end.node = take_next();
    end.number = 0u;
    end.before = -BEYOND;
    walk.band = length > 0u ? band_before(end.node) : border_band(values.x);
    if (!borders(walk.band, values.x)) return false;
    Band band = current_band();
    walk.distance = inside.x;
    walk.position = band_position(band.value_low, band.inverse_width, values.x);
    pass_hidden(end, length, inside, values);
    bool ended;
    do {
        if (!end.broken) {
            band = current_band();
            float position = end.leaving ? band_position(band.value_low, band.inverse_width, values.y) : is_rising(end.node) ? 1.0 : 0.0;
            advance(end.distance, position, end.leaving ? UNKNOWN_SLOPE : signed_slope(end.node), end.leaving ? NO_NORMAL : end.node.normal);
            if (!end.leaving) {
                composite_level(int(end.node.surface & LEVEL_MASK), node_slope(end.node), end.node.normal);
                pass_crossing(end, length);
            }
        }
        ended = end.broken || end.leaving || walk.transmittance < frame.min_transmittance;
        if (!ended) pass_hidden(end, length, inside, values);
        ended = ended || end.broken || (end.leaving && is_hidden());
    } while (!ended);
    if (end.broken) return false;
    if (walk.transmittance >= frame.min_transmittance) return true;
    // Behind an opaque front the rest has to go on, too: else another band might be the one in which the walk begins.
    if (!end.leaving) {
        do {
            look_at_end(end, length, inside, values);
            if (!end.broken && !end.leaving) pass_crossing(end, length);
        } while (!end.broken && !end.leaving);
    }
    if (end.broken) return false;
    atomicAdd(counters.terminated_rays, 1u);
    return true;
}

#else
// Whether an empty list is a chain, and nothing is visible in its only band.
bool is_empty_chain(vec3 origin, vec2 inside) {
    if (!is_seen(inside)) return true;
    vec2 values = face_values(origin, inside);
    int band = border_band(values.x);
    return band_at(band).extinction_max == 0.0 && borders(band, values.y);
}
#endif
