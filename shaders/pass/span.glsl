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

// Decides how the span from `entry` to its border is walked, from the sum of its crossings.
//   If they lead from the band of the entry's value to that of the exit's, none was lost: the span is balanced, and every
// crossing moves the walk by one band, whatever its level. That holds too where the meshes of neighbouring levels cut each
// other inside a cell, so that crossings stand in the wrong order. Where a face's value and the surfaces disagree within
// the face's tolerance, the surfaces decide. Anything else is a loss: levels are then put in where they are missing.
void weigh_span(Node entry, uint index, uint i, uint length, bool in_array, Node last) {
    int net = 0;
    int first_before = -1;
    int last_after = -1;
    Node node = last;
    for (; i < length; ++i) {
        if (i > 0u) index = next_in_list(index, i, in_array);
        else if (in_array) index = sorted_indices[0];
        node = nodes[index];
        if (is_domain(node)) break;
        if (first_before < 0) first_before = band_before(node);
        last_after = band_after(node);
        net += is_rising(node) ? 1 : -1;
    }
    if (i == length) node = last;
    bool bordered = is_domain(node);
    int leaving = bordered ? band_of(border_value(node)) : last_after;
    walk.balanced = true;
    walk.leave_by_value = false;
    if (first_before < 0) {
        float slack = border_tolerance(entry) + (bordered ? border_tolerance(node) : 0.0);
        walk.leave_by_value = bordered;
        if (bordered && !may_be_in(walk.band, border_value(node), slack)) ++walk.violations;
        return;
    }
    if (walk.band + net == leaving) return;
    bool entry_fits = may_be_in(first_before, border_value(entry), border_tolerance(entry));
    bool exit_fits = !bordered || may_be_in(last_after, border_value(node), border_tolerance(node));
    if (first_before + net == last_after && entry_fits && exit_fits) begin_in(first_before);
    else if (first_before + net == leaving && entry_fits) begin_in(first_before);
    else if (walk.band + net != last_after || !exit_fits) {
        walk.balanced = false;
        walk.leave_by_value = !exit_fits;
        if (entry_fits) begin_in(first_before);
        if (!exit_fits) ++walk.violations;
    }
}

// The band from which the walk goes through a node. In a span that is not balanced, levels between the walk's band and
// the node's were lost.
int band_at(Node node) {
    if (is_domain(node)) return walk.leave_by_value ? band_of(border_value(node)) : walk.band;
    int before = band_before(node);
    if (walk.band == before) return before;
    if (walk.balanced) {
        ++walk.reordered;
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
    int level = domain ? -1 : int(node.surface & LEVEL_MASK);
    int target = band_at(node);
    Band band = current_band();
    float start = walk.distance;
    float end = max(node.distance, start);
    float value_start = mix(band.value_low, band.value_high, walk.position);
    float value_end = domain ? border_value(node) : bands[level].value_high;
    bool arrived;
    do {
        arrived = walk.band == target;
        bool upwards = arrived ? rising : walk.band < target;
        int crossed = arrived ? level : (upwards ? walk.band : walk.band - 1);
        float distance = end;
        float position = end_towards(crossed);
        uint normal = domain ? 0u : node.normal;
        if (!arrived) {
            float part = (bands[crossed].value_high - value_start) / (value_end - value_start);
            distance = max(walk.distance, mix(start, end, value_end != value_start ? clamp(part, 0.0, 1.0) : 0.5));
            normal = walk.normal;
        } else if (domain) {
            band = current_band();
            position = band_position(band.value_low, band.inverse_width, value_end);
        }
        advance(distance, position, normal);
        if (crossed >= 0) {
            composite_impulse(crossed, normal);
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
