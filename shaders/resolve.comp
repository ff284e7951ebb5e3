#version 450 core
// Resolve pass, compute entry (faster on most GPUs): one pixel's list to one colour.

#ifndef SORT_CAPACITY
#error "SORT_CAPACITY: longest list that is sorted in a local array"
#endif
#ifndef SEGMENT_RULE
#error "SEGMENT_RULE: 0 constant, 1 - exp(-tau h); 1 constant, tau h (eq. 3 as written); 2 linear; 3 cubic"
#endif
#ifndef SHADING
#error "SHADING: 1 lights the colours with the stored normals, 0 does not"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/spline.glsl"
#include "lib/optics.glsl"
#include "lib/segment.glsl"
#include "lib/bands.glsl"
#include "lib/octahedral.glsl"
#include "lib/shading.glsl"
#include "pass/resolve.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba32f, binding = BINDING_IMAGE) writeonly uniform image2D image;

void main() {
    ivec2 in_tile = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(in_tile, frame.tile_size))) return;
    ivec2 pixel = frame.tile_origin + in_tile;
    imageStore(image, pixel, resolve_pixel(pixel));
}
