// Sorting of one pixel's list by (distance, direction, level): short lists by insertion into a local array, lists of any
// other length by merge sort on the links, in place. Expects the buffer `nodes` and the constant SORT_CAPACITY.

uint sorted_indices[SORT_CAPACITY];
float sorted_distances[SORT_CAPACITY];

// Order of two nodes at one distance: falling before rising; rising levels ascend, falling ones descend (the direction of
// travel); then slope and normal, so that equal keys mean interchangeable nodes and the picture does not depend on the
// order of the triangles.
bool tie_precedes(uint first, uint second) {
    Node one = load_node(first);
    Node other = load_node(second);
    uint a = one.surface;
    uint b = other.surface;
    if (a == b) return one.normal < other.normal;
    bool rising_a = (a & RISING_BIT) != 0u;
    bool rising_b = (b & RISING_BIT) != 0u;
    if (rising_a != rising_b) return rising_b;
    uint level_a = a & LEVEL_MASK;
    uint level_b = b & LEVEL_MASK;
    if (level_a != level_b) return rising_a ? level_a < level_b : level_a > level_b;
    return a < b;
}

bool node_precedes(uint first, uint second) {
    float a = load_node(first).distance;
    float b = load_node(second).distance;
    return a < b || (a == b && tie_precedes(first, second));
}

// Length of a list.
uint list_length(uint head) {
    uint length = 0u;
    for (uint index = head; index != LIST_END; index = next_node(index)) ++length;
    return length;
}

// Sorts a list of at most SORT_CAPACITY nodes into sorted_indices.
void sort_into_array(uint head) {
    int length = 0;
    for (uint index = head; index != LIST_END; index = next_node(index)) {
        float distance = load_node(index).distance;
        int place = length++;
        while (place > 0) {
            float before = sorted_distances[place - 1];
            bool stays = before < distance || (before == distance && !tie_precedes(index, sorted_indices[place - 1]));
            if (stays) break;
            sorted_distances[place] = before;
            sorted_indices[place] = sorted_indices[place - 1];
            --place;
        }
        sorted_distances[place] = distance;
        sorted_indices[place] = index;
    }
}

// One pass of a bottom-up merge sort on the links: the list is made of sorted runs of `run` nodes; merges every two
// neighbours and returns the new head. About 2 n loop iterations.
uint merge_runs(uint head, uint run) {
    uint rest = head;
    uint tail = LIST_END;
    head = LIST_END;
    while (rest != LIST_END) {
        uint left = rest;
        uint left_count = 0u;
        while (rest != LIST_END && left_count < run) { rest = next_node(rest); ++left_count; }
        uint right = rest;
        uint right_count = 0u;
        while (left_count > 0u || (right_count < run && right != LIST_END)) {
            bool right_ended = right_count == run || right == LIST_END;
            bool take_left = right_ended || (left_count > 0u && !node_precedes(right, left));
            uint taken = take_left ? left : right;
            if (take_left) { left = next_node(left); --left_count; }
            else { right = next_node(right); ++right_count; }
            if (tail == LIST_END) head = taken;
            else link_node(tail, taken);
            tail = taken;
        }
        rest = right;
    }
    if (tail != LIST_END) link_node(tail, LIST_END);
    return head;
}

// Sorts a list on its links, O(n log n) steps and no memory of its own; returns the head.
uint sort_links(uint head, uint length) {
    for (uint run = 1u; run < length; run *= 2u) head = merge_runs(head, run);
    return head;
}
