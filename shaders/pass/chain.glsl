// Resolve pass, chains: lists in which every crossing leads on from the band into which the one before it led, from the band
// of the value where the ray enters the box to that of the value where it leaves. Almost all are; the others are left to
// pass/resolve.glsl, which makes the same of a chain, bit for bit, but takes longer: software renderers run every branch of a
// shader for all pixels.
// Expects the constants of pass/pixel.glsl and RUNS: how many runs of RUN nodes a list may have.

#include "pass/pixel.glsl"
#include "pass/runs.glsl"

const int CHAIN_WALKED = 0;
const int CHAIN_LEFT = 1;                // to the program of the next class
const int CHAIN_BROKEN = 2;

bool holds(int band, float value) {
    return (band == 0 || bands[band].value_low <= value) && (band == frame.level_count || value < bands[band].value_high);
}

#if RUNS > 0
// Walks along a ray that enters and leaves the box at the distances `inside`, with the values there; false if the list is no
// chain. Nodes at one distance make it none, as more than the distance decides their order.
bool walk_chain(uint length, vec2 inside, vec2 values) {
    begin_merge(length);
    Node node = take_next();
    walk.band = length > 0u ? band_before(node) : band_of(values.x);
    if (!holds(walk.band, values.x)) return false;
    Band band = current_band();
    walk.distance = inside.x;
    walk.position = band_position(band.value_low, band.inverse_width, values.x);
    float before = -BEYOND;
    uint i = 0u;
    do {
        bool leaving = i == length;
        bool goes_on = leaving ? holds(walk.band, values.y) : band_before(node) == walk.band && node.distance > before;
        if (!goes_on) return false;
        before = node.distance;
        bool rising = is_rising(node);
        float slope = node_slope(node);
        float distance = leaving ? inside.y : max(clamp(node.distance, inside.x, inside.y), walk.distance);
        float position = rising ? 1.0 : 0.0;
        if (leaving) {
            band = current_band();
            position = band_position(band.value_low, band.inverse_width, values.y);
        }
        advance(distance, position, leaving ? UNKNOWN_SLOPE : (rising ? slope : -slope), leaving ? NO_NORMAL : node.normal);
        if (!leaving) {
            composite_level(int(node.surface & LEVEL_MASK), slope, node.normal);
            walk.band += rising ? 1 : -1;
            walk.position = rising ? 0.0 : 1.0;
        }
        ++i;
        if (i < length) node = take_next();
    } while (i <= length && walk.transmittance >= frame.min_transmittance);
    if (walk.transmittance >= frame.min_transmittance) return true;
    // Behind an opaque front the rest has to go on, too: else another band might be the one in which the walk begins.
    int last = walk.band;
    for (; i <= length; ++i) {
        bool goes_on = i == length ? holds(last, values.y) : band_before(node) == last && node.distance > before;
        if (!goes_on) return false;
        before = node.distance;
        last = band_after(node);
        if (i + 1u < length) node = take_next();
    }
    atomicAdd(counters.terminated_rays, 1u);
    return true;
}

// Resolves a pixel with the list that begins at `head`.
int resolve_chain(ivec2 pixel, uint head) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    uint length = 0u;
    head = load_list(head, length);
    if (head != LIST_END) return CHAIN_LEFT;
    if (is_seen(inside)) {
        vec2 values = vec2(face_value(origin, inside.x).x, face_value(origin, inside.y).x);
        if (!walk_chain(length, inside, values)) return CHAIN_BROKEN;
    }
    count_list(length);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return CHAIN_WALKED;
}
#else
// Resolves a pixel if its list is empty and nothing is visible in its only band.
int resolve_chain(ivec2 pixel, uint head) {
    if (head != LIST_END) return CHAIN_LEFT;
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    int band = band_of(face_value(origin, inside.x).x);
    bool empty = bands[band].extinction_max == 0.0 && holds(band, face_value(origin, inside.y).x);
    return empty || !is_seen(inside) ? CHAIN_WALKED : CHAIN_LEFT;
}
#endif

// Notes what became of a pixel's list, for the programs that follow.
void note_result(ivec2 pixel, uint head, int result) {
    uint number = pixel_number(pixel - frame.tile_origin);
    if (result == CHAIN_LEFT) atomicAdd(counters.longer_lists, 1u);
    else if (result == CHAIN_BROKEN) { heads[number] = head | BROKEN_LIST; atomicAdd(counters.broken_chains, 1u); }
    else heads[number] = LIST_DONE;
}
