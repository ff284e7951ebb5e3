// Sorting networks for a run of 8, 12 or 16 nodes: comparisons at fixed places, so that the run stays in registers.
// Expects RUN, run_distances, run_surfaces, and with SHADING run_normals.
// Source: Batcher 1968, 19 comparisons, and Green 1969, 60; see Knuth, The Art of Computer Programming 3, section 5.3.4. Of 12 nodes, 39
// comparisons: Dobbelaere, "List of sorting networks" (bertdobbelaere.github.io/sorting_networks.html), 12 inputs.

#if SHADING
#define ORDER_NORMALS(a, b) uint n = run_normals[a]; uint o = run_normals[b]; \
    run_normals[a] = swap ? o : n; run_normals[b] = swap ? n : o;
#else
#define ORDER_NORMALS(a, b)
#endif
#define ORDER(a, b) { float x = run_distances[a]; float y = run_distances[b]; bool swap = y < x; \
    run_distances[a] = min(x, y); run_distances[b] = max(x, y); \
    uint s = run_surfaces[a]; uint t = run_surfaces[b]; \
    run_surfaces[a] = swap ? t : s; run_surfaces[b] = swap ? s : t; ORDER_NORMALS(a, b) }

#define EACH_OF_4(DO, i) DO(i) DO(i + 1) DO(i + 2) DO(i + 3)
#if RUN == 8
#define EACH_OF_RUN(DO) EACH_OF_4(DO, 0) EACH_OF_4(DO, 4)
#elif RUN == 12
#define EACH_OF_RUN(DO) EACH_OF_4(DO, 0) EACH_OF_4(DO, 4) EACH_OF_4(DO, 8)
#else
#define EACH_OF_RUN(DO) EACH_OF_4(DO, 0) EACH_OF_4(DO, 4) EACH_OF_4(DO, 8) EACH_OF_4(DO, 12)
#endif

// Sorts the run by distance; nodes at one distance are left in any order.
void sort_run() {
#if RUN == 8
    ORDER(0, 1) ORDER(2, 3) ORDER(4, 5) ORDER(6, 7)
    ORDER(0, 2) ORDER(1, 3) ORDER(4, 6) ORDER(5, 7)
    ORDER(1, 2) ORDER(5, 6)
    ORDER(0, 4) ORDER(1, 5) ORDER(2, 6) ORDER(3, 7)
    ORDER(2, 4) ORDER(3, 5)
    ORDER(1, 2) ORDER(3, 4) ORDER(5, 6)
#elif RUN == 12
    ORDER(0, 8) ORDER(1, 7) ORDER(2, 6) ORDER(3, 11) ORDER(4, 10) ORDER(5, 9)
    ORDER(0, 1) ORDER(2, 5) ORDER(3, 4) ORDER(6, 9) ORDER(7, 8) ORDER(10, 11)
    ORDER(0, 2) ORDER(1, 6) ORDER(5, 10) ORDER(9, 11)
    ORDER(0, 3) ORDER(1, 2) ORDER(4, 6) ORDER(5, 7) ORDER(8, 11) ORDER(9, 10)
    ORDER(1, 4) ORDER(3, 5) ORDER(6, 8) ORDER(7, 10)
    ORDER(1, 3) ORDER(2, 5) ORDER(6, 9) ORDER(8, 10)
    ORDER(2, 3) ORDER(4, 5) ORDER(6, 7) ORDER(8, 9)
    ORDER(4, 6) ORDER(5, 7)
    ORDER(3, 4) ORDER(5, 6) ORDER(7, 8)
#else
    ORDER(0, 1) ORDER(2, 3) ORDER(4, 5) ORDER(6, 7) ORDER(8, 9) ORDER(10, 11) ORDER(12, 13) ORDER(14, 15)
    ORDER(0, 2) ORDER(4, 6) ORDER(8, 10) ORDER(12, 14) ORDER(1, 3) ORDER(5, 7) ORDER(9, 11) ORDER(13, 15)
    ORDER(0, 4) ORDER(8, 12) ORDER(1, 5) ORDER(9, 13) ORDER(2, 6) ORDER(10, 14) ORDER(3, 7) ORDER(11, 15)
    ORDER(0, 8) ORDER(1, 9) ORDER(2, 10) ORDER(3, 11) ORDER(4, 12) ORDER(5, 13) ORDER(6, 14) ORDER(7, 15)
    ORDER(5, 10) ORDER(6, 9) ORDER(3, 12) ORDER(13, 14) ORDER(4, 8) ORDER(7, 11) ORDER(1, 2)
    ORDER(1, 4) ORDER(7, 13) ORDER(2, 8) ORDER(11, 14)
    ORDER(2, 4) ORDER(5, 6) ORDER(9, 10) ORDER(11, 13) ORDER(3, 8) ORDER(7, 12)
    ORDER(6, 8) ORDER(10, 12) ORDER(3, 5) ORDER(7, 9)
    ORDER(3, 4) ORDER(5, 6) ORDER(7, 8) ORDER(9, 10) ORDER(11, 12)
    ORDER(6, 7) ORDER(8, 9)
#endif
}
