// One stretch of a ray inside the volume: the way from crossing to crossing.
// Expects the other files of pass/ that resolve.glsl includes. Twins: isosample/integral/list_spans.py, list_walk.py

// The band from which the walk goes through a node. In a span that is not balanced, levels between the walk's band and
// the node's were lost.
int band_at(Node node) {
    if (is_domain(node)) return walk.leave_by_value ? band_of(border_value(node)) : walk.band;
    int before = band_before(node);
    if (walk.band == before) return before;
    if (walk.balanced) {
        ++walk.reordered;
        walk.ahead += before - walk.band;
        return walk.band;
    }
    ++walk.violations;
    return before;
}

// Walks to a node: through levels that the list does not hold, where `place_of` puts them, then to the node.
void step_to(Node node) {
    bool domain = is_domain(node);
    bool rising = is_rising(node);
    if (domain && rising) enter(node);
    if (!walk.inside || (domain && rising)) return;       // outside: beside the valid cells by rounding
    if (!domain && passes_over(node)) return;
    int level = domain ? -1 : int(node.surface & LEVEL_MASK);
    int target = band_at(node);
    Band band = current_band();
    GapEnd front = GapEnd(walk.distance, mix(band.value_low, band.value_high, walk.position),
                          walk.slope);
    float node_rise = domain ? UNKNOWN_SLOPE : (rising ? node_slope(node) : -node_slope(node));
    GapEnd back = GapEnd(max(node.distance, walk.distance), domain ? border_value(node) : band_at(level).value_high,
                         node_rise);
    bool arrived;
    do {
        arrived = walk.band == target;
        bool upwards = arrived ? rising : walk.band < target;
        int crossed = arrived ? level : (upwards ? walk.band : walk.band - 1);
        float distance = back.distance;
        float position = end_towards(crossed);
        float slope = arrived ? back.slope : UNKNOWN_SLOPE;
        uint normal = domain ? NO_NORMAL : node.normal;
        if (!arrived) {
            distance = place_of(crossed, upwards, front, back);
            normal = walk.normal;
        } else if (domain) {
            band = current_band();
            position = band_position(band.value_low, band.inverse_width, border_value(node));
        }
        float chord = abs(position - walk.position) / max(distance - walk.distance, 1e-30);
        chord *= current_band().value_high - current_band().value_low;
        advance(distance, position, slope, normal);
        if (crossed >= 0) {
            composite_level(crossed, slope == UNKNOWN_SLOPE ? chord : abs(slope), normal);
            walk.band += upwards ? 1 : -1;
            walk.position = end_towards(crossed);
        }
    } while (!arrived);
    if (domain) walk.inside = false;
}

// Where the next node of a sorted list is: `index` of node `i` - 1 and the number `i`.
uint next_in_list(uint index, uint i, bool in_array) { return in_array ? sorted_indices[i] : next_node(index); }

// A node of the list between the borders of the box (if they are borders): a crossing that was moved onto its curved
// surface, or rounded, may lie a little outside, and is then met at the border.
Node node_between(uint index, Node first, Node last) {
    Node node = load_node(index);
    if (is_domain(last) && !is_domain(node)) node.distance = clamp(node.distance, first.distance, last.distance);
    return node;
}

// Weighs the span from `entry` on: the crossings from node `i` on, up to the next border or the end of the list.
void weigh_span(Node entry, uint index, uint i, uint length, bool in_array, Node first, Node last) {
    Weighing sums = begin_weighing();
    Node node = last;
    for (; i < length; ++i) {
        if (i > 0u) index = next_in_list(index, i, in_array);
        else if (in_array) index = sorted_indices[0];
        node = node_between(index, first, last);
        if (is_domain(node)) break;
        weigh(sums, node);
    }
    if (i == length) node = last;
    decide(sums, entry, node);
}

// Steps from `first` to every node of a sorted list, then to `last`; the two only if they are borders.
void walk_list(uint head, uint length, bool in_array, Node first, Node last) {
    uint count = length + (is_domain(last) ? 1u : 0u);
    uint index = head;
    if (is_domain(first)) {
        enter(first);
        weigh_span(first, index, 0u, length, in_array, first, last);
    }
    uint i = 0u;
    for (; i < count; ++i) {
        Node node = last;
        if (i < length) {
            if (i > 0u) index = next_in_list(index, i, in_array);
            else if (in_array) index = sorted_indices[0];
            node = node_between(index, first, last);
        }
        step_to(node);
        if (is_domain(node) && is_rising(node)) weigh_span(node, index, i + 1u, length, in_array, first, last);
        if (walk.transmittance < frame.min_transmittance) {
            atomicAdd(counters.terminated_rays, 1u);
            return;
        }
    }
    if (i < count) atomicAdd(counters.unfinished_rays, 1u);  // see LINK_SORT_LIMIT in lib/layouts.glsl
}
