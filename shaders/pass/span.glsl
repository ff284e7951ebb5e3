// One stretch of a ray inside the volume: the way from crossing to crossing.
// Expects the other files of pass/ that resolve.glsl includes. Twins: isosample/integral/list_spans.py, list_walk.py

// End of the current band that is nearer to a level.
float end_towards(int level) { return level >= walk.band ? 1.0 : 0.0; }

void enter(Node node) {
    float value = border_value(node);
    walk.inside = true;
    walk.distance = node.distance;
    walk.band = band_of(value);
    walk.position = band_position(bands[walk.band].value_low, bands[walk.band].inverse_width, value);
    walk.slope = UNKNOWN_SLOPE;
    walk.normal = 0u;
}

// True for a crossing that a balanced walk passes over: where a ray hardly touches a surface, its two crossings may stand
// in the wrong order, and the walk goes through neither. Not so where an earlier crossing came too soon: this is then the
// one that came too late.
bool passes_over(Node node) {
    bool rising = is_rising(node);
    int level = int(node.surface & LEVEL_MASK);
    bool owed = walk.debt != 0 && (walk.debt > 0) == rising;
    bool first = walk.debt == 0 && walk.ahead == 0 && level == (rising ? walk.band - 1 : walk.band);
    if (!walk.balanced || !(owed || first)) return false;
    walk.debt += rising ? -1 : 1;
    ++walk.reordered;
    return true;
}

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
    GapEnd back = GapEnd(max(node.distance, walk.distance), domain ? border_value(node) : bands[level].value_high,
                         node_rise);
    bool arrived;
    do {
        arrived = walk.band == target;
        bool upwards = arrived ? rising : walk.band < target;
        int crossed = arrived ? level : (upwards ? walk.band : walk.band - 1);
        float distance = back.distance;
        float position = end_towards(crossed);
        float slope = arrived ? back.slope : UNKNOWN_SLOPE;
        uint normal = domain ? 0u : node.normal;
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
