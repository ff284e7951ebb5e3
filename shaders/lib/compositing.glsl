// Compositing of premultiplied linear RGBA, unitless.
// Twin: isosample/integral/compositing.py

// Composites `front` over `back`.
//   C = C_front + (1 - a_front) C_back                 (Porter and Duff 1984, "over")
// Error: 3 roundings, |err| <= gamma(3) (|front| + |back|).
vec4 over(vec4 front, vec4 back) { return front + (1.0 - front.a) * back; }
