// Resolve pass, chains: lists in which every crossing leads on from the band into which the one before it led, from the band
// of the value where the ray enters the box to that of the value where it leaves. Almost all are; the others are left to
// pass/resolve.glsl, which makes the same of a chain, bit for bit, but takes longer: software renderers run every branch of a
// shader for all pixels.
// Expects the constants of pass/pixel.glsl and RUNS: how many runs of RUN nodes a list may have. Every run is sorted in
// registers; the sorted runs are merged as the walk goes.

#include "pass/pixel.glsl"

const int RUN = 16;
const float BEYOND = 3e38;                // no distance is larger
const int CHAIN_WALKED = 0;
const int CHAIN_LEFT = 1;                // to the program of the next class
const int CHAIN_BROKEN = 2;

bool holds(int band, float value) {
    return (band == 0 || bands[band].value_low <= value) && (band == frame.level_count || value < bands[band].value_high);
}

#if RUNS > 0
float run_distances[RUN];                 // indexed by constants only, so that they stay in registers
uint run_surfaces[RUN];
float sorted_distances[RUN * RUNS];
uint sorted_surfaces[RUN * RUNS];
#if SHADING
uint run_normals[RUN];
uint sorted_normals[RUN * RUNS];
#endif

#include "pass/network.glsl"

#if SHADING
#define LOAD_NORMAL(i) run_normals[i] = node.normal;
#define STORE_NORMAL(i) sorted_normals[first + i] = run_normals[i];
#else
#define LOAD_NORMAL(i)
#define STORE_NORMAL(i)
#endif
#define LOAD_NODE(i) run_distances[i] = BEYOND; \
    if (index != LIST_END) { \
        Node node = load_node(index); \
        run_distances[i] = node.distance; run_surfaces[i] = node.surface; LOAD_NORMAL(i) \
        index = node.next_index; ++length; }
#define STORE_NODE(i) sorted_distances[first + i] = run_distances[i]; sorted_surfaces[first + i] = run_surfaces[i]; \
    STORE_NORMAL(i)

// Loads the next run of the list, sorts it and stores it from `first` on; returns where the list goes on, and adds to its
// length.
uint load_run(uint index, int first, inout uint length) {
    EACH_OF_RUN(LOAD_NODE)
    sort_run();
    EACH_OF_RUN(STORE_NODE)
    return index;
}

// Loads and sorts a list, as much of it as there is room for; returns where it goes on.
uint load_list(uint head, inout uint length) {
    for (int first = 0; first < RUN * RUNS && head != LIST_END; first += RUN) head = load_run(head, first, length);
    return head;
}

float run_next[RUNS];                     // distance of the next node of every run, BEYOND where there is none
int run_place[RUNS];                      // and where it is

void begin_merge(uint length) {
    for (int run = 0; run < RUNS; ++run) {
        run_place[run] = run * RUN;
        run_next[run] = uint(run * RUN) < length ? sorted_distances[run * RUN] : BEYOND;
    }
}

// Where the next node is in the arrays.
int next_place() {
    int nearest = 0;
    int place = run_place[0];
    float distance = run_next[0];
    for (int run = 1; run < RUNS; ++run) {
        bool nearer = run_next[run] < distance;
        distance = nearer ? run_next[run] : distance;
        place = nearer ? run_place[run] : place;
        nearest = nearer ? run : nearest;
    }
    int after = place + 1;
    float next = after % RUN != 0 ? sorted_distances[after] : BEYOND;
    for (int run = 0; run < RUNS; ++run) {
        run_place[run] = run == nearest ? after : run_place[run];
        run_next[run] = run == nearest ? next : run_next[run];
    }
    return place;
}

Node take_next() {
    int place = next_place();
#if SHADING
    return Node(LIST_END, sorted_distances[place], sorted_surfaces[place], sorted_normals[place]);
#else
    return Node(LIST_END, sorted_distances[place], sorted_surfaces[place], 0u);
#endif
}

// Walks along a ray that enters and leaves the box at the distances `inside`, with the values there; false if the list is no
// chain. Nodes at one distance make it none, as more than the distance decides their order.
bool walk_chain(uint length, vec2 inside, vec2 values) {
    begin_merge(length);
    Node node = take_next();
    walk.band = length > 0u ? band_before(node) : band_of(values.x);
    if (!holds(walk.band, values.x)) return false;
    Band band = current_band();
    walk.distance = inside.x;
    walk.position = band_position(band.value_low, band.inverse_width, values.x);
    float before = -BEYOND;
    uint i = 0u;
    for (; i <= length && walk.transmittance >= frame.min_transmittance; ++i) {
        bool leaving = i == length;
        bool goes_on = leaving ? holds(walk.band, values.y) : band_before(node) == walk.band && node.distance > before;
        if (!goes_on) return false;
        before = node.distance;
        bool rising = is_rising(node);
        float slope = node_slope(node);
        float distance = leaving ? inside.y : max(clamp(node.distance, inside.x, inside.y), walk.distance);
        float position = rising ? 1.0 : 0.0;
        if (leaving) {
            band = current_band();
            position = band_position(band.value_low, band.inverse_width, values.y);
        }
        advance(distance, position, leaving ? UNKNOWN_SLOPE : (rising ? slope : -slope), leaving ? 0u : node.normal);
        if (leaving) continue;
        composite_level(int(node.surface & LEVEL_MASK), slope, node.normal);
        walk.band += rising ? 1 : -1;
        walk.position = rising ? 0.0 : 1.0;
        if (i + 1u < length) node = take_next();
    }
    if (walk.transmittance >= frame.min_transmittance) return true;
    // Behind an opaque front the rest has to go on, too: else another band might be the one in which the walk begins.
    int last = walk.band;
    for (; i <= length; ++i) {
        bool goes_on = i == length ? holds(last, values.y) : band_before(node) == last && node.distance > before;
        if (!goes_on) return false;
        before = node.distance;
        last = band_after(node);
        if (i + 1u < length) node = take_next();
    }
    atomicAdd(counters.terminated_rays, 1u);
    return true;
}

// Resolves a pixel with the list that begins at `head`.
int resolve_chain(ivec2 pixel, uint head) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    uint length = 0u;
    head = load_list(head, length);
    if (head != LIST_END) return CHAIN_LEFT;
    if (is_seen(inside)) {
        vec2 values = vec2(face_value(origin, inside.x).x, face_value(origin, inside.y).x);
        if (!walk_chain(length, inside, values)) return CHAIN_BROKEN;
    }
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
    int band = band_of(face_value(origin, inside.x).x);
    bool empty = bands[band].extinction_max == 0.0 && holds(band, face_value(origin, inside.y).x);
    return empty || !is_seen(inside) ? CHAIN_WALKED : CHAIN_LEFT;
}
#endif

// Notes what became of a pixel's list, for the programs that follow.
void note_result(ivec2 pixel, uint head, int result) {
    uint number = pixel_number(pixel - frame.tile_origin);
    if (result == CHAIN_LEFT) atomicAdd(counters.longer_lists, 1u);
    else if (result == CHAIN_BROKEN) { heads[number] = head | BROKEN_LIST; atomicAdd(counters.broken_chains, 1u); }
    else heads[number] = LIST_DONE;
}
