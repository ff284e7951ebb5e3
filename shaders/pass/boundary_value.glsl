// The field's value where a ray meets the box: bilinear on the stored face, which is the trilinear field
// there, or the bicubic of a smooth reconstruction.
// Expects `frame`, pass/tables.glsl, `boundary` and `ray_direction` of the resolve pass.

// Four coefficients of a smooth face in a row; the rows are two longer than those of samples.
vec4 face_taps(int corner) {
    return vec4(boundary[corner], boundary[corner + 1], boundary[corner + 2], boundary[corner + 3]);
}

// Normalised value on the face where the ray is at `distance`, and how far it may lie on the wrong side of an isovalue:
// see face_tolerance in lib/ray.glsl. Faces are stored as x low, x high, y low, ...; a face of
// axis a is indexed by the other two axes, the lower one fastest.
vec2 face_value(vec3 origin, float distance) {
    vec3 unit = clamp(unit_from_local(origin + distance * ray_direction, 1.0), 0.0, 1.0);
    ivec3 samples = ivec3(frame.samples_xy, frame.samples_z);
    ivec3 stored = samples + 2 * SMOOTH_FACES;
    int face = nearest_face(unit);
    int axis = face / 2;
    ivec3 face_sizes = ivec3(stored.y * stored.z, stored.x * stored.z, stored.x * stored.y);
    int offset = (axis > 0 ? 2 * face_sizes.x : 0) + (axis > 1 ? 2 * face_sizes.y : 0) + (face % 2) * face_sizes[axis];
    int axis_u = axis == 0 ? 1 : 0;
    int axis_v = axis == 2 ? 1 : 2;
    vec2 position = vec2(unit[axis_u], unit[axis_v]) * vec2(samples[axis_u] - 1, samples[axis_v] - 1);
    ivec2 cell = min(ivec2(position), ivec2(samples[axis_u], samples[axis_v]) - 2);
    vec2 part = position - vec2(cell);
    int row = stored[axis_u];
    int corner = offset + cell.y * row + cell.x;
#if SMOOTH_FACES
        vec4 taps[4] = vec4[](face_taps(corner), face_taps(corner + row), face_taps(corner + 2 * row),
                              face_taps(corner + 3 * row));
        vec4 weights_u = tap_weights(frame.face_kernel, part.x);
        vec4 weights_v = tap_weights(frame.face_kernel, part.y);
        return vec2(spline_face_value(taps, weights_u, weights_v), spline_face_tolerance(taps));
#else
    vec4 corners = vec4(boundary[corner], boundary[corner + 1], boundary[corner + row], boundary[corner + row + 1]);
    return vec2(bilinear(corners, part.x, part.y), face_tolerance(corners));
#endif
}

// Band that holds a normalised value: as many levels lie at or below it.
int band_of(float value) {
    int low = 0;
    int high = frame.level_count;
    while (low < high) {
        int middle = (low + high) / 2;
        if (band_at(middle).value_high <= value) low = middle + 1;
        else high = middle;
    }
    return low;
}
