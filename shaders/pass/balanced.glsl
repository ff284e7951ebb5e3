// Resolve pass, balanced lists: those that are no chains, but whose crossings add up (see pass/weigh.glsl), as where the
// meshes of neighbouring levels cut each other inside a cell. Nothing has to be put in, so that what
// pass/resolve.glsl does for lost crossings, and runs for every pixel, is left out; the picture is the same, bit for bit.
// Expects the constants of pass/pixel.glsl and RUNS: how many runs of RUN nodes a list may have.

#include "pass/pixel.glsl"
#include "pass/runs.glsl"
#include "pass/weigh.glsl"
#include "pass/step.glsl"

// The next node, between the borders of the box.
Node take_inside(vec2 inside) {
    Node node = take_next();
    node.distance = clamp(node.distance, inside.x, inside.y);
    return node;
}

// Adds up the crossings; false where two stand at one distance, as more than that decides their order.
bool weigh_runs(uint length, vec2 inside, Node entry, Node exit) {
    Weighing sums = begin_weighing();
    float before = -BEYOND;
    begin_merge(length);
    for (uint i = 0u; i < length; ++i) {
        Node node = take_next();
        if (node.distance == before) return false;
        before = node.distance;
        node.distance = clamp(node.distance, inside.x, inside.y);
        weigh(sums, node);
    }
    decide(sums, entry, exit);
    return walk.balanced;
}

// Walks through a crossing, by one band in its direction, whatever its level.
void step_through(Node node) {
    if (passes_over(node)) return;
    int ahead = band_before(node) - walk.band;
    if (ahead != 0) ++walk.reordered;
    walk.ahead += ahead;
    bool rising = is_rising(node);
    int level = int(node.surface & LEVEL_MASK);
    float slope = node_slope(node);
    advance(max(node.distance, walk.distance), end_towards(level), rising ? slope : -slope, node.normal);
    composite_level(level, slope, node.normal);
    walk.band += rising ? 1 : -1;
    walk.position = end_towards(level);
}

// Leaves the box.
void step_out(float distance, float value) {
    Band band = current_band();
    advance(max(distance, walk.distance), band_position(band.value_low, band.inverse_width, value), UNKNOWN_SLOPE, NO_NORMAL);
}

// Resolves a pixel with the list that begins at `head`; false, with nothing counted, if it is too long or not balanced.
bool resolve_balanced(ivec2 pixel, uint head) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    uint length = 0u;
    head = load_list(head, length);
    if (head != LIST_END || length == 0u || !is_seen(inside)) return false;
    Node entry = border_node(inside.x, face_value(origin, inside.x), true);
    Node exit = border_node(inside.y, face_value(origin, inside.y), false);
    enter(entry);
    if (!weigh_runs(length, inside, entry, exit)) return false;
    begin_merge(length);
    uint i = 0u;
    for (; i < length && walk.transmittance >= frame.min_transmittance; ++i) step_through(take_inside(inside));
    if (walk.transmittance >= frame.min_transmittance) step_out(inside.y, border_value(exit));
    if (walk.transmittance < frame.min_transmittance) atomicAdd(counters.terminated_rays, 1u);
    count_list(length);
    if (walk.reordered > 0u) atomicAdd(counters.reordered_fragments, walk.reordered);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return true;
}
