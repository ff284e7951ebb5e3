// Pre-integration by a table of the two values of a stretch: INTEGRATION 1 for one length, 2 for lengths in equal ratios. What
// another length adds follows from the opacity, 1 - (1 - a)^(d / d0), with the colour scaled alike; of two layers, each brought
// to the stretch's length, the mean by the logarithm of the length is taken.
// Source: Engel et al. 2001; Lum et al. 2004. Twin: isosample/transfer/preintegration.py

#if METHOD == 1 && (INTEGRATION == 1 || INTEGRATION == 2)
#if INTEGRATION == 1
layout(binding = UNIT_PRE_INTEGRATION) uniform sampler2D length_table;
#else
layout(binding = UNIT_PRE_INTEGRATION) uniform sampler3D length_tables;
#endif

vec4 table_texel(ivec2 nodes, int layer) {
#if INTEGRATION == 1
    return textureLod(length_table, (vec2(nodes) + 0.5) / vec2(textureSize(length_table, 0)), 0.0);
#else
    return textureLod(length_tables, (vec3(nodes, layer) + 0.5) / vec3(textureSize(length_tables, 0)), 0.0);
#endif
}

// What a stretch of the layer's length adds.
vec4 table_entry(vec2 values, int layer) {
#if INTEGRATION == 1
    int size = textureSize(length_table, 0).x;
#else
    int size = textureSize(length_tables, 0).x;
#endif
    vec2 places = clamp(values, 0.0, 1.0) * float(size - 1);
    ivec2 low = min(ivec2(places), ivec2(size - 2));
    vec2 parts = places - vec2(low);
    vec4 near = mix(table_texel(low, layer), table_texel(low + ivec2(1, 0), layer), parts.x);
    vec4 far = mix(table_texel(low + ivec2(0, 1), layer), table_texel(low + ivec2(1, 1), layer), parts.x);
    return mix(near, far, parts.y);
}

// Optical depth -log(1 - a) of an opacity, without cancellation: below 1/8 by its series, the rest of which is less than
// a^8 / 8 = 7e-9 of it.
float depth_of(float opacity) {
    if (opacity >= 0.125) return opacity < 1.0 ? -log(1.0 - opacity) : 1e30;
    float sum = 0.0;
    for (int i = 8; i > 0; --i) sum = 1.0 / float(i) + opacity * sum;
    return opacity * sum;
}

// What a stretch `ratio` times as long adds.
vec4 relengthed(vec4 entry, float ratio) {
    return entry.a > 0.0 ? entry * (opacity_from_depth(depth_of(entry.a) * ratio) / entry.a) : vec4(0.0);
}

void composite_entry(Stretch stretch) {
    vec2 values = vec2(stretch.front, stretch.back);
    float ratio = (stretch.end - stretch.start) / raycast.table_length;
#if INTEGRATION == 1
    vec4 entry = table_entry(values, 0);
    if (abs(ratio - 1.0) > 1e-4) entry = relengthed(entry, ratio);
#else
    float place = clamp(log(ratio) / raycast.table_ratio, 0.0, float(raycast.table_layers - 1));
    int layer = min(int(place), raycast.table_layers - 2);
    float shorter = ratio * exp(-raycast.table_ratio * float(layer));
    vec4 entry = mix(relengthed(table_entry(values, layer), shorter),
                     relengthed(table_entry(values, layer + 1), shorter * exp(-raycast.table_ratio)), place - float(layer));
#endif
    if (!(entry.a > 0.0)) return;
#if SHADING
    composite(entry.a * lit(entry.rgb / entry.a, 0.5 * (stretch.start + stretch.end)), entry.a);
#else
    composite(entry.rgb, entry.a);
#endif
}
#endif
