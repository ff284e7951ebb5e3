// Unit vectors in 32 bits: octahedral map, two signed 16-bit numbers.
// Source: Meyer et al. 2010, "On floating-point normal vectors"; Cigolle et al. 2014 (JCGT 3(2)), "oct".
// Twin: isosample/integral/octahedral.py

vec2 octahedral_fold(vec2 p) {
    return (1.0 - abs(p.yx)) * vec2(p.x >= 0.0 ? 1.0 : -1.0, p.y >= 0.0 ? 1.0 : -1.0);
}

// Packs a unit vector. Rounding to 1/32767 moves p by e = 0.5 / 32767 along x and y at most, so the point of the
// octahedron by (e, e, -2e), length sqrt(6) e, at 1/sqrt(3) or more from the centre: 3 sqrt(2) e = 6.48e-5 rad, and
// float32 roundings add 2e-6. packSnorm2x16 never makes -32768 of a number: NO_NORMAL is the code of none.
uint pack_normal(vec3 n) {
    float norm = abs(n.x) + abs(n.y) + abs(n.z);
    vec2 p = n.xy / max(norm, 1e-30);
    if (n.z < 0.0) p = octahedral_fold(p);
    return packSnorm2x16(p);
}

vec3 unpack_normal(uint bits) {
    vec2 p = unpackSnorm2x16(bits);
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    if (n.z < 0.0) n.xy = octahedral_fold(p);
    return normalize(n);
}
