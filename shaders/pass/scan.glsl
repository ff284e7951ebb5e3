// The scan of a triangle, for the build pass by compute shaders.

// Of where an edge cuts a row [pixel]: of at most 121 pixels, by a conversion, a reciprocal of 2.5 units in the last place and a
// product, together 121 * 4 * 2^-23 = 6e-5.
const float SLACK = 1e-3;

// The pixels of a box, row by row from where a triangle's edges cut the row to where they cut it again. In float32, with SLACK: every
// pixel inside lies between them, and the whole numbers decide whether one is inside.
struct Scan {
    ivec3 row;                            // edge functions in the first column of the row, and of the next one
    ivec3 next_row;
    ivec3 along_x, along_y;               // what is added from pixel to pixel
    vec3 inverse_x;
    int width;                            // of the box, less one
    int column, end;                      // of the row: the present pixel, and the last one, from the first column on
    int y;                                // of the row
};

// Into the next row, before its first pixel between the edges.
void to_next_row(inout Scan scan) {
    scan.row = scan.next_row;
    scan.next_row += scan.along_y;
    ++scan.y;
    vec3 cut = -vec3(scan.row) * scan.inverse_x;
    vec3 left = mix(vec3(0.0), cut, greaterThan(scan.along_x, ivec3(0)));
    vec3 right = mix(vec3(float(scan.width)), cut, lessThan(scan.along_x, ivec3(0)));
    float from = ceil(max(max(left.x, left.y), max(left.z, 0.0)) - SLACK);
    float to = floor(min(min(right.x, right.y), min(right.z, float(scan.width))) + SLACK);
    scan.column = int(min(from, float(scan.width + 1)));
    scan.end = int(max(to, -1.0));
}

// To the next pixel between the edges, or beyond the row `last`: what follows is executed by all lanes that have one.
void to_next_pixel(inout Scan scan, int last) {
    ++scan.column;
    do {
        if (scan.column > scan.end) to_next_row(scan);
    } while (scan.column > scan.end && scan.y <= last);
}
