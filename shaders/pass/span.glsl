// One stretch of a ray inside the volume: which band each crossing leads to, with the crossings added up beforehand.
// Expects pass/walk.glsl, pass/sort_lists.glsl and pass/boundary_value.glsl. Twin: isosample/integral/data_centric.py

bool is_rising(Node node) { return (node.surface & RISING_BIT) != 0u; }

bool is_domain(Node node) { return (node.surface & LEVEL_MASK) == DOMAIN_LEVEL; }

int band_before(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 0 : 1); }

int band_after(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 1 : 0); }

// End of the current band that is nearer to a level.
float end_towards(int level) { return level >= walk.band ? 1.0 : 0.0; }

// The point where the ray leaves the box, as a node.
Node leaving_node(float distance, float value) {
    return Node(LIST_END, distance, DOMAIN_LEVEL, floatBitsToUint(value));
}

void enter(float distance, float value) {
    walk.inside = true;
    walk.distance = distance;
    walk.band = band_of(value);
    walk.position = band_position(bands[walk.band].value_low, bands[walk.band].inverse_width, value);
    walk.normal = 0u;
    walk.fresh = true;
}

// Where the next node of a sorted list is: `index` of node `i` - 1 and the number `i`.
uint next_in_list(uint index, uint i, bool in_array) { return in_array ? sorted_indices[i] : nodes[index].next_index; }

// Adds up the crossings from node `i` to the end of the span. If they lead from the band of the entry to that of the
// exit, none was lost: the span is balanced, and every crossing moves the walk by one band, whatever its level. That
// holds too where the meshes of neighbouring levels cut each other inside a cell, so that crossings stand in the wrong
// order. Where the face's value and the surfaces disagree about the band at the box (the face is bilinear, the mesh's
// outline on it a chord; or by rounding), the surfaces decide.
void weigh_span(uint index, uint i, uint length, bool in_array, Node last) {
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
    int leaving = is_domain(node) ? band_of(uintBitsToFloat(node.normal)) : last_after;
    bool by_entry = walk.band + net == leaving;
    bool by_first = first_before + net == leaving || first_before + net == last_after;
    walk.balanced = first_before < 0 || by_entry || by_first || walk.band + net == last_after;
    if (first_before >= 0 && !by_entry && by_first && walk.band != first_before) {
        walk.position = walk.band < first_before ? 0.0 : 1.0;
        walk.band = first_before;
    }
}

// The band from which the walk goes through a node. In a span that is not balanced, levels between the walk's band and
// the node's were lost, or before the first crossing the face's value is wrong.
int band_at(Node node) {
    if (is_domain(node)) return walk.fresh ? band_of(uintBitsToFloat(node.normal)) : walk.band;
    int before = band_before(node);
    if (walk.band == before) return before;
    if (walk.balanced) {
        ++walk.reordered;
        return walk.band;
    }
    ++walk.violations;
    if (walk.fresh) {
        walk.position = walk.band < before ? 0.0 : 1.0;
        walk.band = before;
    }
    return before;
}

// Walks to a node: through levels that the list does not hold, where a linear course meets them, then to the node.
void step_to(Node node) {
    bool domain = is_domain(node);
    bool rising = is_rising(node);
    if (domain && rising) enter(node.distance, uintBitsToFloat(node.normal));
    if (!walk.inside || (domain && rising)) return;       // outside: beside the valid cells by rounding
    int level = domain ? -1 : int(node.surface & LEVEL_MASK);
    int target = band_at(node);
    Band band = current_band();
    float start = walk.distance;
    float end = max(node.distance, start);
    float value_start = mix(band.value_low, band.value_high, walk.position);
    float value_end = domain ? uintBitsToFloat(node.normal) : bands[level].value_high;
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
    walk.fresh = false;
    if (domain) walk.inside = false;
}

// Steps to every node of a sorted list, then to `last` unless it is no border.
void walk_list(uint head, uint length, bool in_array, Node last) {
    uint count = length + (is_domain(last) ? 1u : 0u);
    uint index = head;
    if (walk.inside) weigh_span(index, 0u, length, in_array, last);
    for (uint i = 0u; i < count; ++i) {
        Node node = last;
        if (i < length) {
            if (i > 0u) index = next_in_list(index, i, in_array);
            else if (in_array) index = sorted_indices[0];
            node = nodes[index];
        }
        step_to(node);
        if (is_domain(node) && is_rising(node)) weigh_span(index, i + 1u, length, in_array, last);
        if (walk.transmittance < frame.min_transmittance) {
            atomicAdd(counters.terminated_rays, 1u);
            return;
        }
    }
}
