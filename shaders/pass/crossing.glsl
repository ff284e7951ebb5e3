// The node of a crossing with a triangle: what the entries of the build pass, which rasterise, find at a pixel. Expects the
// constants SHADING, CURVED and RESIDUAL, and `level`.

struct Crossing {
    vec3 gradient;     // of the normalised value, times the box radius
    float depth;       // signed distance along the view direction [world]
    vec3 position;     // where CURVED: local [world],
    float moment;      // gradient . position at the corners, interpolated, see lib/curved.glsl,
    bool curved;       // and whether the crossing moves onto the curved surface
    float residual;    // where RESIDUAL: how far the field is from the isovalue [normalised]
};

Crossing no_crossing() { return Crossing(vec3(0.0), 0.0, vec3(0.0), 0.0, false, 0.0); }

// Appends a crossing to the list of a pixel with this unnormalised ray. `rising`: along the ray the value rises.
void append_crossing(ivec2 pixel, vec3 ray, Crossing found, bool rising) {
    float scale = length(ray);
    float along = dot(found.gradient, ray) / scale;
    float distance = found.depth * scale;
    float steepness = length(found.gradient);
#if CURVED
    float error = curved_error(found.gradient, found.position, found.moment);
    if (found.curved) distance += curved_shift(error, along, steepness, frame.curved_limit, rising);
#endif
    uint surface = level | (rising ? RISING_BIT : 0u) | (packHalf2x16(vec2(min(abs(along), LARGEST_HALF), 0.0)) << 16);
#if RESIDUAL
    uint normal = floatBitsToUint(found.residual);
#elif SHADING
    uint normal = steepness > 0.0 ? pack_normal(found.gradient / steepness) : NO_NORMAL;
#else
    uint normal = NO_NORMAL;
#endif
    append_node(pixel, distance, surface, normal);
}
