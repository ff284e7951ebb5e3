// Rays of the picture and their interval in the volume's box.
// Twin: isosample/integral/ray.py

// Position of a pixel centre on the image plane, in [-1, 1] (x to the right, y up).
vec2 image_plane_position(ivec2 pixel, ivec2 image_size) {
    return 2.0 * (vec2(pixel) + 0.5) / vec2(image_size) - 1.0;
}

// Interval of the ray parameter inside one slab 0 <= origin + t direction <= 1; (1, -1) if it misses.
vec2 slab_interval(float origin, float direction) {
    if (direction == 0.0) return origin >= 0.0 && origin <= 1.0 ? vec2(-1e30, 1e30) : vec2(1.0, -1.0);
    float a = -origin / direction;
    float b = (1.0 - origin) / direction;
    return vec2(min(a, b), max(a, b));
}

// Interval of the ray inside the unit box (Kay and Kajiya 1986); empty if x >= y.
vec2 box_interval(vec3 origin, vec3 direction) {
    vec2 x = slab_interval(origin.x, direction.x);
    vec2 y = slab_interval(origin.y, direction.y);
    vec2 z = slab_interval(origin.z, direction.z);
    if (x.x > x.y || y.x > y.y || z.x > z.y) return vec2(1.0, -1.0);
    return vec2(max(max(x.x, y.x), z.x), min(min(x.y, y.y), z.y));
}

// Face of the unit box nearest to a point on its surface: 2 * axis + side (0 low, 1 high).
int nearest_face(vec3 unit) {
    vec3 low = abs(unit);
    vec3 high = abs(1.0 - unit);
    int face = 0;
    float nearest = low.x;
    if (high.x < nearest) { face = 1; nearest = high.x; }
    if (low.y < nearest) { face = 2; nearest = low.y; }
    if (high.y < nearest) { face = 3; nearest = high.y; }
    if (low.z < nearest) { face = 4; nearest = low.z; }
    if (high.z < nearest) { face = 5; nearest = high.z; }
    return face;
}

// Bilinear interpolation of the four corners of a face cell, u and v in [0, 1].
float bilinear(vec4 corners, float u, float v) {
    return mix(mix(corners.x, corners.y, u), mix(corners.z, corners.w, u), v);
}

// Largest difference of normalised values between the bilinear field on a face cell and what the mesh's outline on it
// stands for. The outline is a chord of the bilinear isoline: |mixed difference| / 4; a rasterised outline is off by up to
// 1/256 pixel, and pixels may be several cells: 2 % of the cell's range; and float32 rounding: 1e-5.
float face_tolerance(vec4 corners) {
    float mixed = abs(corners.x - corners.y - corners.z + corners.w);
    float low = min(min(corners.x, corners.y), min(corners.z, corners.w));
    float high = max(max(corners.x, corners.y), max(corners.z, corners.w));
    return 0.25 * mixed + 0.02 * (high - low) + 1e-5;
}
