// The field between the samples, and its gradient, at a place in sample indices.
// Expects the block `raycast`, and the constants RECONSTRUCTION (0 trilinear, 1 four taps along every axis) and FILTERING
// (0 in the shader; by the texture unit: 1 with two linear fetches along every axis of four taps, 2 with three, where the
// weights of the taps are of either sign).
// In the shader: samples are gathered four at a time from layers of a 2-D array, so that every bit of them counts; on
// software renderers that takes less time than any other exact way. No loops: some drivers limit how often they turn.

#include "lib/trilinear.glsl"
#include "lib/spline.glsl"

#if FILTERING == 0
layout(binding = UNIT_VOLUME) uniform sampler2DArray volume;
#else
layout(binding = UNIT_VOLUME) uniform sampler3D volume;
#endif

const vec4 ABSENT = vec4(1e38);   // neighbours outside the grid, above MASKED_VALUE

#if FILTERING == 0
vec2 texel_size = 1.0 / vec2(textureSize(volume, 0).xy);   // computed once per call of the shader

// The corner that four texels share, in texture coordinates, and their layer.
vec3 corner_of(ivec3 texel) { return vec3(vec2(texel.xy + 1) * texel_size, float(texel.z)); }
#endif

// Four texels of one z: (x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1); outside the grid those at its border.
vec4 quad_at(ivec3 texel) {
#if FILTERING == 0
    return textureGather(volume, corner_of(texel)).wzxy;
#else
    ivec3 size = textureSize(volume, 0);
    ivec3 low = clamp(texel, ivec3(0), size - 1);
    ivec2 high = min(texel.xy + 1, size.xy - 1);
    return vec4(texelFetch(volume, low, 0).r, texelFetch(volume, ivec3(high.x, low.yz), 0).r,
                texelFetch(volume, ivec3(low.x, high.y, low.z), 0).r, texelFetch(volume, ivec3(high, low.z), 0).r);
#endif
}

// First sample of the cell that holds a place; the last sample belongs to the last cell.
ivec3 cell_at(vec3 index) { return clamp(ivec3(index), ivec3(0), max(raycast.samples.xyz - 2, ivec3(0))); }

#if RECONSTRUCTION == 0

float field(vec3 index) {
#if FILTERING == 0
    ivec3 cell = cell_at(index);
    vec3 corner = corner_of(cell);
    vec4 above = textureGather(volume, vec3(corner.xy, corner.z + 1.0)).wzxy;
    return trilinear(textureGather(volume, corner).wzxy, above, index - vec3(cell));
#else
    return textureLod(volume, (index + 0.5) / vec3(raycast.samples.xyz), 0.0).r;
#endif
}

// Slopes along x of the four samples `here` that begin at a texel; `ends`: whether it is the first, the last cell.
vec4 slopes_x(ivec3 texel, vec4 here, bvec2 ends) {
    vec4 left = ends.x ? ABSENT : quad_at(texel - ivec3(1, 0, 0));
    vec4 right = ends.y ? ABSENT : quad_at(texel + ivec3(1, 0, 0));
    return sample_slopes(vec4(left.x, here.x, left.z, here.z), here, vec4(here.y, right.y, here.w, right.w), MASKED_VALUE);
}

// The same along y.
vec4 slopes_y(ivec3 texel, vec4 here, bvec2 ends) {
    vec4 front = ends.x ? ABSENT : quad_at(texel - ivec3(0, 1, 0));
    vec4 back = ends.y ? ABSENT : quad_at(texel + ivec3(0, 1, 0));
    return sample_slopes(vec4(front.xy, here.xy), here, vec4(here.zw, back.zw), MASKED_VALUE);
}

// Trilinear interpolation of the central differences at the samples, one-sided at the border and beside masked samples.
vec3 field_gradient(vec3 index) {
    ivec3 cell = cell_at(index);
    ivec3 up = ivec3(0, 0, 1);
    vec3 fraction = index - vec3(cell);
    bvec3 first = equal(cell, ivec3(0));
    bvec3 last = greaterThanEqual(cell + 2, raycast.samples.xyz);
    vec4 low = quad_at(cell);
    vec4 high = quad_at(cell + up);
    bvec2 ends_x = bvec2(first.x, last.x);
    bvec2 ends_y = bvec2(first.y, last.y);
    vec4 below = first.z ? ABSENT : quad_at(cell - up);
    vec4 above = last.z ? ABSENT : quad_at(cell + 2 * up);
    return vec3(trilinear(slopes_x(cell, low, ends_x), slopes_x(cell + up, high, ends_x), fraction),
                trilinear(slopes_y(cell, low, ends_y), slopes_y(cell + up, high, ends_y), fraction),
                trilinear(sample_slopes(below, low, high, MASKED_VALUE), sample_slopes(low, high, above, MASKED_VALUE), fraction));
}

#else  // the coefficient of sample (0, 0, 0) is texel (1, 1, 1), so that a cell's first tap is the texel of its number

// Four by four coefficients of one z.
float weighed_layer(ivec3 texel, vec4 weights_x, vec4 weights_y) {
    return weighed_quad(quad_at(texel), weights_x.xy, weights_y.xy)
         + weighed_quad(quad_at(texel + ivec3(2, 0, 0)), weights_x.zw, weights_y.xy)
         + weighed_quad(quad_at(texel + ivec3(0, 2, 0)), weights_x.xy, weights_y.zw)
         + weighed_quad(quad_at(texel + ivec3(2, 2, 0)), weights_x.zw, weights_y.zw);
}

#if FILTERING == 0

float field(vec3 index) {
    ivec3 cell = cell_at(index);
    vec3 fraction = index - vec3(cell);
    vec4 weights_x = tap_weights(raycast.kernel, fraction.x);
    vec4 weights_y = tap_weights(raycast.kernel, fraction.y);
    return dot(tap_weights(raycast.kernel, fraction.z), vec4(weighed_layer(cell, weights_x, weights_y),
                                                            weighed_layer(cell + ivec3(0, 0, 1), weights_x, weights_y),
                                                            weighed_layer(cell + ivec3(0, 0, 2), weights_x, weights_y),
                                                            weighed_layer(cell + ivec3(0, 0, 3), weights_x, weights_y)));
}

#else

// Linear fetches along one axis: their weights, and their places behind the first tap [texel].
struct Fetches {
    vec3 weights;
    vec3 places;
};

Fetches fetches_at(float fraction) {
    vec4 weights = tap_weights(raycast.kernel, fraction);
#if FILTERING == 1
    vec2 front = paired_taps(weights.xy);
    vec2 back = paired_taps(weights.zw);
    return Fetches(vec3(front.x, back.x, 0.0), vec3(front.y, 2.0 + back.y, 0.0));
#else
    vec2 middle = paired_taps(weights.yz);
    return Fetches(vec3(weights.x, middle.x, weights.w), vec3(0.0, 1.0 + middle.y, 3.0));
#endif
}

float fetched(vec3 texel) { return textureLod(volume, (texel + 0.5) / vec3(textureSize(volume, 0)), 0.0).r; }

float fetched_row(Fetches x, vec3 texel) {
    float sum = x.weights.x * fetched(texel + vec3(x.places.x, 0.0, 0.0)) + x.weights.y * fetched(texel + vec3(x.places.y, 0.0, 0.0));
#if FILTERING == 2
    sum += x.weights.z * fetched(texel + vec3(x.places.z, 0.0, 0.0));
#endif
    return sum;
}

float fetched_layer(Fetches x, Fetches y, vec3 texel) {
    float sum = y.weights.x * fetched_row(x, texel + vec3(0.0, y.places.x, 0.0)) + y.weights.y * fetched_row(x, texel + vec3(0.0, y.places.y, 0.0));
#if FILTERING == 2
    sum += y.weights.z * fetched_row(x, texel + vec3(0.0, y.places.z, 0.0));
#endif
    return sum;
}

float field(vec3 index) {
    vec3 cell = vec3(cell_at(index));
    vec3 fraction = index - cell;
    Fetches x = fetches_at(fraction.x);
    Fetches y = fetches_at(fraction.y);
    Fetches z = fetches_at(fraction.z);
    float sum = z.weights.x * fetched_layer(x, y, cell + vec3(0.0, 0.0, z.places.x))
              + z.weights.y * fetched_layer(x, y, cell + vec3(0.0, 0.0, z.places.y));
#if FILTERING == 2
    sum += z.weights.z * fetched_layer(x, y, cell + vec3(0.0, 0.0, z.places.z));
#endif
    return sum;
}

#endif

// Derivatives along x, y, and the value, in one layer of coefficients.
vec3 layer_slopes(ivec3 texel, vec4 weights_x, vec4 weights_y, vec4 slopes_x, vec4 slopes_y) {
    return vec3(weighed_layer(texel, slopes_x, weights_y), weighed_layer(texel, weights_x, slopes_y),
                weighed_layer(texel, weights_x, weights_y));
}

// The kernel's own derivative.
vec3 field_gradient(vec3 index) {
    ivec3 cell = cell_at(index);
    vec3 fraction = index - vec3(cell);
    vec4 weights_x = tap_weights(raycast.kernel, fraction.x);
    vec4 weights_y = tap_weights(raycast.kernel, fraction.y);
    vec4 weights_z = tap_weights(raycast.kernel, fraction.z);
    vec4 slopes_x = tap_slopes(raycast.kernel, fraction.x);
    vec4 slopes_y = tap_slopes(raycast.kernel, fraction.y);
    vec4 slopes_z = tap_slopes(raycast.kernel, fraction.z);
    vec3 a = layer_slopes(cell, weights_x, weights_y, slopes_x, slopes_y);
    vec3 b = layer_slopes(cell + ivec3(0, 0, 1), weights_x, weights_y, slopes_x, slopes_y);
    vec3 c = layer_slopes(cell + ivec3(0, 0, 2), weights_x, weights_y, slopes_x, slopes_y);
    vec3 d = layer_slopes(cell + ivec3(0, 0, 3), weights_x, weights_y, slopes_x, slopes_y);
    return vec3(dot(weights_z, vec4(a.x, b.x, c.x, d.x)), dot(weights_z, vec4(a.y, b.y, c.y, d.y)),
                dot(slopes_z, vec4(a.z, b.z, c.z, d.z)));
}

#endif
