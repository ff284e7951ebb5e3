// One stretch of a ray inside the volume: which band each crossing leads to, with the crossings added up beforehand.
// Expects the other files of pass/ that resolve.glsl includes. Twin: isosample/integral/data_centric.py

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

// Begins in the band that the first surface says instead of the one of the face's value.
void begin_in(int band) {
    if (walk.band == band) return;
    walk.position = walk.band < band ? 0.0 : 1.0;
    walk.band = band;
}

// Where the next node of a sorted list is: `index` of node `i` - 1 and the number `i`.
uint next_in_list(uint index, uint i, bool in_array) { return in_array ? sorted_indices[i] : nodes[index].next_index; }

// A walk that moves by one band per crossing, and the crossings on its way that do not fit.
struct Trial {
    int band;
    int misfits;                          // of the present place
    int shift;                            // and the sum of their distances from the walk [bands]
    float first, last;                    // and where it begins and ends [world]
    bool lost;
};

// Meshes of neighbouring levels that cut each other inside a cell change the order of two or more crossings there. One
// that does not fit alone, or many over a longer way, tell that two crossings in opposite directions were lost.
void close_place(inout Trial trial) {
    if (trial.misfits == 1 || trial.last - trial.first > frame.reach) trial.lost = true;
    trial.misfits = 0;
}

void follow(inout Trial trial, Node node) {
    int shift = band_before(node) - trial.band;
    trial.band += is_rising(node) ? 1 : -1;
    if (shift == 0) return;
    if (trial.misfits > 0 && node.distance - trial.last > frame.reach) close_place(trial);
    if (trial.misfits == 0) { trial.first = node.distance; trial.shift = 0; }
    ++trial.misfits;
    trial.shift += shift;
    trial.last = node.distance;
    if (trial.shift == 0) close_place(trial);
}

// Decides how the span from `entry` to its border is walked, from the sum of its crossings.
//   If they lead from the band of the entry's value to that of the exit's, none was lost: the span is balanced, and every
// crossing moves the walk by one band, whatever its level. That holds too where the meshes of neighbouring levels cut each
// other inside a cell, so that crossings stand in the wrong order. Where a face's value and the surfaces disagree within
// the face's tolerance, the surfaces decide. Anything else is a loss: levels are then put in where they are missing.
void weigh_span(Node entry, uint index, uint i, uint length, bool in_array, Node last) {
    int net = 0;
    int first_before = -1;
    int last_after = -1;
    Trial by_value = Trial(walk.band, 0, 0, 0.0, 0.0, false);
    Trial by_surface = by_value;
    Node node = last;
    for (; i < length; ++i) {
        if (i > 0u) index = next_in_list(index, i, in_array);
        else if (in_array) index = sorted_indices[0];
        node = nodes[index];
        if (is_domain(node)) break;
        if (first_before < 0) by_surface.band = first_before = band_before(node);
        last_after = band_after(node);
        net += is_rising(node) ? 1 : -1;
        follow(by_value, node);
        follow(by_surface, node);
    }
    if (i == length) node = last;
    bool bordered = is_domain(node);
    int leaving = bordered ? band_of(border_value(node)) : last_after;
    walk.balanced = true;
    walk.leave_by_value = false;
    walk.ahead = 0;
    walk.debt = 0;
    if (first_before < 0) {
        float slack = border_tolerance(entry) + (bordered ? border_tolerance(node) : 0.0);
        walk.leave_by_value = bordered;
        if (bordered && !may_be_in(walk.band, border_value(node), slack)) ++walk.violations;
        return;
    }
    if (by_value.misfits > 0) close_place(by_value);
    if (by_surface.misfits > 0) close_place(by_surface);
    bool entry_fits = may_be_in(first_before, border_value(entry), border_tolerance(entry));
    bool exit_fits = !bordered || may_be_in(last_after, border_value(node), border_tolerance(node));
    if (walk.band + net == leaving && !by_value.lost) return;
    bool chained = first_before + net == leaving || (first_before + net == last_after && exit_fits);
    if (chained && entry_fits && !by_surface.lost) begin_in(first_before);
    else if (walk.band + net != last_after || !exit_fits || by_value.lost) {
        walk.balanced = false;
        walk.leave_by_value = !exit_fits;
        if (entry_fits) begin_in(first_before);
        if (!exit_fits) ++walk.violations;
    }
}

// True for a crossing that a balanced walk passes over: where a ray hardly touches a surface, its two crossings may stand
// in the wrong order, and the walk goes through neither. Not so
// where an earlier crossing came too soon: this is then the one that came too late.
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

// Walks to a node: through levels that the list does not hold, where a linear course meets them, then to the node.
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
        weigh_span(first, index, 0u, length, in_array, last);
    }
    for (uint i = 0u; i < count; ++i) {
        Node node = last;
        if (i < length) {
            if (i > 0u) index = next_in_list(index, i, in_array);
            else if (in_array) index = sorted_indices[0];
            node = nodes[index];
        }
        step_to(node);
        if (is_domain(node) && is_rising(node)) weigh_span(node, index, i + 1u, length, in_array, last);
        if (walk.transmittance < frame.min_transmittance) {
            atomicAdd(counters.terminated_rays, 1u);
            return;
        }
    }
}
