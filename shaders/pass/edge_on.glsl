// Triangles seen so nearly from their edge that what they interpolate is not to be trusted. Expects `frame` and the constant SUBPIXEL_BITS.

// Whether a step of the grid to which the rasteriser moves vertices, before it decides what is covered, is worth a cell of
// distance: the pixel's centre may then be outside of the triangle, and what is interpolated is extrapolated, to anywhere.
// `change` is that of the distance along the view direction from pixel to pixel (of x and of y together), `scale` the length of
// the ray whose component along it is 1.
bool is_edge_on(float change, float scale) { return change * scale > float(1 << SUBPIXEL_BITS) * frame.reach; }
