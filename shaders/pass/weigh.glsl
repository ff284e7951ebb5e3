// How a span of a ray is walked: its crossings added up beforehand, and held against a walk by one band per crossing.
// Expects pass/walk.glsl and pass/node.glsl. Twin: isosample/integral/list_spans.py

// Begins in the band that the first surface says instead of the one of the face's value.
void begin_in(int band) {
    if (walk.band == band) return;
    walk.position = walk.band < band ? 0.0 : 1.0;
    walk.band = band;
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

// The crossings of a span, added up: the sum of their directions, the first and the last band, and how walks that begin in
// the band of the entry's value, and in that of the first crossing, would fare.
struct Weighing {
    int net;
    int first_before;                     // -1: there is no crossing
    int last_after;
    Trial by_value;
    Trial by_surface;
};

Weighing begin_weighing() {
    Trial trial = Trial(walk.band, 0, 0, 0.0, 0.0, false);
    return Weighing(0, -1, -1, trial, trial);
}

// Adds the next crossing of the span.
void weigh(inout Weighing sums, Node node) {
    if (sums.first_before < 0) sums.by_surface.band = sums.first_before = band_before(node);
    sums.last_after = band_after(node);
    sums.net += is_rising(node) ? 1 : -1;
    follow(sums.by_value, node);
    follow(sums.by_surface, node);
}

// Decides how the span from `entry` to `exit`, its border or its last crossing, is walked, from the sums of its crossings.
//   If they lead from the band of the entry's value to that of the exit's, none was lost: the span is balanced, and every
// crossing moves the walk by one band, whatever its level. That holds too where the meshes of neighbouring levels cut each
// other inside a cell, so that crossings stand in the wrong order. Where a face's value and the surfaces disagree within
// the face's tolerance, the surfaces decide. Anything else is a loss: levels are then put in where they are missing.
void decide(inout Weighing sums, Node entry, Node exit) {
    bool bordered = is_domain(exit);
    int leaving = bordered ? band_of(border_value(exit)) : sums.last_after;
    walk.balanced = true;
    walk.leave_by_value = false;
    walk.ahead = 0;
    walk.debt = 0;
    if (sums.first_before < 0) {
        float slack = border_tolerance(entry) + (bordered ? border_tolerance(exit) : 0.0);
        walk.leave_by_value = bordered;
        if (bordered && !may_be_in(walk.band, border_value(exit), slack)) ++walk.violations;
        return;
    }
    if (sums.by_value.misfits > 0) close_place(sums.by_value);
    if (sums.by_surface.misfits > 0) close_place(sums.by_surface);
    bool entry_fits = may_be_in(sums.first_before, border_value(entry), border_tolerance(entry));
    bool exit_fits = !bordered || may_be_in(sums.last_after, border_value(exit), border_tolerance(exit));
    if (walk.band + sums.net == leaving && !sums.by_value.lost) return;
    bool chained = sums.first_before + sums.net == leaving || (sums.first_before + sums.net == sums.last_after && exit_fits);
    if (chained && entry_fits && !sums.by_surface.lost) begin_in(sums.first_before);
    else if (walk.band + sums.net != sums.last_after || !exit_fits || sums.by_value.lost) {
        walk.balanced = false;
        walk.leave_by_value = !exit_fits;
        if (entry_fits) begin_in(sums.first_before);
        if (!exit_fits) ++walk.violations;
    }
}
