// Resolve pass, chains in slots. Expects pass/chain.glsl and its constants.

#include "pass/packets.glsl"
#include "pass/slots.glsl"

#if RUNS > 0
#if SHADING
#define LOAD_SLOT_NORMAL(i) run_normals[i] = imageLoad(slot_normals, texel).x;
#else
#define LOAD_SLOT_NORMAL(i)
#endif
#define LOAD_SLOT(i) run_distances[i] = BEYOND; \
    if (first + uint(i) < length) { \
        int texel = slot_place(packet, first + uint(i), place); \
        uvec2 slot = imageLoad(slots, texel).xy; \
        run_distances[i] = uintBitsToFloat(slot.x); run_surfaces[i] = slot.y; LOAD_SLOT_NORMAL(i) }

// Loads a run of the list in the slots, from number `first` on, sorts it and stores it.
void load_slots(uint packet, uint place, uint first, uint length) {
    EACH_OF_RUN(LOAD_SLOT)
    sort_run();
    EACH_OF_RUN(STORE_NODE)
}
#endif

// Resolves a pixel with a list in slots; false, with nothing counted, if it is no chain. Where there are few runs each has a call of
// its own, which takes a tenth less time than a loop, but longer to compile.
bool resolve_slots(ivec2 pixel, uint packet, uint place, uint length) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
#if RUNS == 0
    return is_empty_chain(origin, inside);
#else
#if RUNS <= 4
    load_slots(packet, place, 0u, length);
#if RUNS > 1
    load_slots(packet, place, uint(RUN), length);
#endif
#if RUNS > 2
    load_slots(packet, place, uint(2 * RUN), length);
#endif
#if RUNS > 3
    load_slots(packet, place, uint(3 * RUN), length);
#endif
#else
    uint first = 0u;
    do {
        load_slots(packet, place, first, length);
        first += uint(RUN);
    } while (first < length && first < uint(RUN * RUNS));
#endif
    if (is_seen(inside) && !walk_chain(length, inside, face_values(origin, inside))) return false;
    if (length > 0u) atomicAdd(counters.walked_count, length);  // group_packets.comp knows the longest already
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return true;
#endif
}
