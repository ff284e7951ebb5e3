// How a span of a ray is walked: its crossings added up beforehand, and held against a walk by one band per crossing.
// Expects the other files of pass/ that resolve.glsl includes. Twin: isosample/integral/list_spans.py

// Begins in the band that the first surface says instead of the one of the face's value.
void begin_in(int band) {
    if (walk.band == band) return;
    walk.position = walk.band < band ? 0.0 : 1.0;
    walk.band = band;
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
void weigh_span(Node entry, uint index, uint i, uint length, bool in_array, Node first, Node last) {
    int net = 0;
    int first_before = -1;
    int last_after = -1;
    Trial by_value = Trial(walk.band, 0, 0, 0.0, 0.0, false);
    Trial by_surface = by_value;
    Node node = last;
    for (; i < length; ++i) {
        if (i > 0u) index = next_in_list(index, i, in_array);
        else if (in_array) index = sorted_indices[0];
        node = node_between(index, first, last);
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

