// Resolve pass, chains in linked lists. Expects pass/chain.glsl and its constants.

const int CHAIN_WALKED = 0;
const int CHAIN_LEFT = 1;                // to the program of the next class
const int CHAIN_BROKEN = 2;

#if RUNS > 0
// Resolves a pixel with the list that begins at `head`.
int resolve_chain(ivec2 pixel, uint head) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    uint length = 0u;
    head = load_list(head, length);
    if (head != LIST_END) return CHAIN_LEFT;
    if (is_seen(inside) && !walk_chain(length, inside, face_values(origin, inside))) return CHAIN_BROKEN;
    count_list(length);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return CHAIN_WALKED;
}
#else
// Resolves a pixel if its list is empty and nothing is visible in its only band.
int resolve_chain(ivec2 pixel, uint head) {
    if (head != LIST_END) return CHAIN_LEFT;
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    return is_empty_chain(origin, inside) ? CHAIN_WALKED : CHAIN_LEFT;
}
#endif

// Notes what became of a pixel's list, for the programs that follow.
void note_result(ivec2 pixel, uint head, int result) {
    uint number = pixel_number(pixel - frame.tile_origin);
    if (result == CHAIN_LEFT) atomicAdd(counters.longer_lists, 1u);
    else if (result == CHAIN_BROKEN) { heads[number] = head | BROKEN_LIST; atomicAdd(counters.broken_chains, 1u); }
    else heads[number] = LIST_DONE;
}
