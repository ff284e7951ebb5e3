// A list sorted by distance: runs of RUN nodes, each sorted in registers, and merged as they are taken.
// Expects the buffers of pass/pixel.glsl, RUN, 8, 12 or 16, and RUNS: how many runs a list may have.

const float BEYOND = 3e38;                // no distance is larger

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
    int first = 0;
    do {
        head = load_run(head, first, length);
        first += RUN;
    } while (first < RUN * RUNS && head != LIST_END);
    return head;
}

float run_next[RUNS];                     // distance of the next node of every run, BEYOND where there is none
int run_place[RUNS];                      // and where it is

void begin_merge(uint length) {
#if RUNS == 1
    run_place[0] = 0;
#else
    for (int run = 0; run < RUNS; ++run) {
        run_place[run] = run * RUN;
        run_next[run] = uint(run * RUN) < length ? sorted_distances[run * RUN] : BEYOND;
    }
#endif
}

// Where the next node is in the arrays.
int next_place() {
#if RUNS == 1
    return run_place[0]++;
#else
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
#endif
}

Node take_next() {
    int place = next_place();
#if SHADING
    return Node(LIST_END, sorted_distances[place], sorted_surfaces[place], sorted_normals[place]);
#else
    return Node(LIST_END, sorted_distances[place], sorted_surfaces[place], NO_NORMAL);
#endif
}
#endif
