// Parts of a stretch that every method composites: a slab whose optics run linearly, and a surface. Expects
// pass/transfer.glsl, and light_at and composite of pass/raycast.glsl.

int spent_loops = 0;                      // turns of the loops inside composite_stretch so far, as some drivers limit these

vec3 kept_light = vec3(-1.0, 1.0, 0.0);   // light_at the distance x, as parts meet there

vec3 lit(vec3 straight, float distance) {
#if SHADING
    if (distance != kept_light.x) kept_light = vec3(distance, light_at(distance));
    return straight * kept_light.y + kept_light.z;
#else
    return straight;
#endif
}

// A way of `length` from the distance `start` to `end` (the difference of which is not as precise where they are close), with
// optics (straight linear RGB, extinction) at the two.
void composite_slab(float start, float length, float end, vec4 front, vec4 back) {
    if (!(front.a > 0.0 || back.a > 0.0) || !(length > 0.0)) return;
    vec2 weights = segment_weights(front.a * length, back.a * length);
    composite(weights.x * lit(front.rgb, start) + weights.y * lit(back.rgb, end), weights.x + weights.y);
}

// One crossing: `surface` is straight linear RGB and opacity.
void composite_surface(float distance, vec4 surface) {
    if (!(surface.a > 0.0)) return;
    ++ray.crossings;
    composite(surface.a * lit(surface.rgb, distance), surface.a);
}
