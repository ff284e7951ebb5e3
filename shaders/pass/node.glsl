// What a node of a list says: a crossing of a level, or a point on the border of the volume. Expects pass/tables.glsl and `frame`.

bool is_rising(Node node) { return (node.surface & RISING_BIT) != 0u; }

bool is_domain(Node node) { return (node.surface & LEVEL_MASK) == DOMAIN_LEVEL; }

int band_before(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 0 : 1); }

int band_after(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 1 : 0); }

// |df/dt| of the normalised value [1/world]; < 0 where the node has none.
float node_slope(Node node) { return is_domain(node) ? -1.0 : unpackHalf2x16(node.surface >> 16).x / frame.box_radius; }

float border_value(Node node) { return uintBitsToFloat(node.normal); }

float border_tolerance(Node node) { return unpackHalf2x16(node.surface >> 16).x; }

// A point of the border of the volume, as a node; `face` is the value there and its tolerance.
Node border_node(float distance, vec2 face, bool entering) {
    uint surface = DOMAIN_LEVEL | (entering ? RISING_BIT : 0u) | (packHalf2x16(vec2(face.y, 0.0)) << 16);
    return Node(LIST_END, distance, surface, floatBitsToUint(face.x));
}

// True if a value on the border may belong to a band: it lies in it, or beside it by the tolerance at most.
bool may_be_in(int index, float value, float tolerance) {
    Band band = band_at(clamp(index, 0, frame.level_count));
    bool above = index == 0 || value >= band.value_low - tolerance;
    bool below = index == frame.level_count || value <= band.value_high + tolerance;
    return above && below;
}
