// How a walk begins at a border, and what it passes over: shared by the programs for balanced spans and for any span.
// Expects pass/walk.glsl and pass/node.glsl. Twin: isosample/integral/list_walk.py

// End of the current band that is nearer to a level.
float end_towards(int level) { return level >= walk.band ? 1.0 : 0.0; }

void enter(Node node) {
    float value = border_value(node);
    walk.inside = true;
    walk.distance = node.distance;
    walk.band = band_of(value);
    Band band = band_at(walk.band);
    walk.position = band_position(band.value_low, band.inverse_width, value);
    walk.slope = UNKNOWN_SLOPE;
    walk.normal = NO_NORMAL;
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
