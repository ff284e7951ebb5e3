// Sorting networks for the runs of a list: comparisons at fixed places, so that the run stays in registers.
// Expects run_distances, run_surfaces, with SHADING run_normals, and the constant RUN: 16 or 32 nodes.
// Source: Green 1969 (16: 60 comparisons, see Knuth, The Art of Computer Programming 3, 5.3.4); Batcher 1968 (odd-even merge).

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
#define EACH_OF_16(DO, i) EACH_OF_4(DO, i) EACH_OF_4(DO, i + 4) EACH_OF_4(DO, i + 8) EACH_OF_4(DO, i + 12)
#if RUN == 32
#define EACH_OF_RUN(DO) EACH_OF_16(DO, 0) EACH_OF_16(DO, 16)
#else
#define EACH_OF_RUN(DO) EACH_OF_16(DO, 0)
#endif

// Sorts the run by distance; nodes at one distance are left in any order.
void sort_run() {
    // the first 16
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
#if RUN == 32
    // the last 16
    ORDER(16, 17) ORDER(18, 19) ORDER(20, 21) ORDER(22, 23) ORDER(24, 25) ORDER(26, 27) ORDER(28, 29) ORDER(30, 31)
    ORDER(16, 18) ORDER(20, 22) ORDER(24, 26) ORDER(28, 30) ORDER(17, 19) ORDER(21, 23) ORDER(25, 27) ORDER(29, 31)
    ORDER(16, 20) ORDER(24, 28) ORDER(17, 21) ORDER(25, 29) ORDER(18, 22) ORDER(26, 30) ORDER(19, 23) ORDER(27, 31)
    ORDER(16, 24) ORDER(17, 25) ORDER(18, 26) ORDER(19, 27) ORDER(20, 28) ORDER(21, 29) ORDER(22, 30) ORDER(23, 31)
    ORDER(21, 26) ORDER(22, 25) ORDER(19, 28) ORDER(29, 30) ORDER(20, 24) ORDER(23, 27) ORDER(17, 18)
    ORDER(17, 20) ORDER(23, 29) ORDER(18, 24) ORDER(27, 30)
    ORDER(18, 20) ORDER(21, 22) ORDER(25, 26) ORDER(27, 29) ORDER(19, 24) ORDER(23, 28)
    ORDER(22, 24) ORDER(26, 28) ORDER(19, 21) ORDER(23, 25)
    ORDER(19, 20) ORDER(21, 22) ORDER(23, 24) ORDER(25, 26) ORDER(27, 28)
    ORDER(22, 23) ORDER(24, 25)
    // the two, merged
    ORDER(0, 16) ORDER(1, 17) ORDER(2, 18) ORDER(3, 19) ORDER(4, 20) ORDER(5, 21) ORDER(6, 22) ORDER(7, 23) ORDER(8, 24)
    ORDER(9, 25) ORDER(10, 26) ORDER(11, 27) ORDER(12, 28) ORDER(13, 29) ORDER(14, 30) ORDER(15, 31)
    ORDER(8, 16) ORDER(9, 17) ORDER(10, 18) ORDER(11, 19) ORDER(12, 20) ORDER(13, 21) ORDER(14, 22) ORDER(15, 23)
    ORDER(4, 8) ORDER(5, 9) ORDER(6, 10) ORDER(7, 11) ORDER(12, 16) ORDER(13, 17) ORDER(14, 18) ORDER(15, 19) ORDER(20, 24)
    ORDER(21, 25) ORDER(22, 26) ORDER(23, 27)
    ORDER(2, 4) ORDER(3, 5) ORDER(6, 8) ORDER(7, 9) ORDER(10, 12) ORDER(11, 13) ORDER(14, 16) ORDER(15, 17) ORDER(18, 20)
    ORDER(19, 21) ORDER(22, 24) ORDER(23, 25) ORDER(26, 28) ORDER(27, 29)
    ORDER(1, 2) ORDER(3, 4) ORDER(5, 6) ORDER(7, 8) ORDER(9, 10) ORDER(11, 12) ORDER(13, 14) ORDER(15, 16) ORDER(17, 18)
    ORDER(19, 20) ORDER(21, 22) ORDER(23, 24) ORDER(25, 26) ORDER(27, 28) ORDER(29, 30)
#endif
}
