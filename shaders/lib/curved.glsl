// From a point on a triangle to the curved isosurface through its vertices.
// Source: the mean of the first-order expansions about the three vertices, exact for quadratic fields (compare Nagata 2005
// and Vlachos et al. 2001, "Curved PN triangles").
// Twin: isosample/integral/curved.py

const float LEAST_INCLINE = 0.15;        // smallest cosine between ray and gradient that a shift is computed with

// How far the field at a point of a triangle is from the isovalue of its vertices [value]: half of G.p - s, with the
// gradient G, the position p and s = gradient . position interpolated between the vertices.
//   f(p) - v = sum_i w_i G_i.(p - p_i) / 2 + O(h^3), as the expansion about vertex i gives G_i.(p - p_i) to second order
//   and the second-order terms cancel against the other half.
float curved_error(vec3 gradient, vec3 position, float moment) { return 0.5 * (dot(gradient, position) - moment); }

// Way along the ray to the isosurface [world], one Newton step, at most `limit` in either direction. `along` is the
// gradient's component along the ray, `steepness` its length. 0 where the gradient says otherwise than the triangle whether
// the value is `rising`: the step would lead to the ray's other crossing with the surface, and past it.
float curved_shift(float error, float along, float steepness, float limit, bool rising) {
    float incline = rising ? along : -along;
    float shift = error / max(max(incline, LEAST_INCLINE * steepness), 1e-30);
    return incline > 0.0 ? clamp(rising ? -shift : shift, -limit, limit) : 0.0;
}
