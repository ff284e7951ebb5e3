#version 450 core
// Resolve pass, balanced lists up to a length, compute entry (faster on most GPUs): one pixel's list to one colour.

#ifndef RUNS
#error "RUNS: how many runs of 16 nodes a list may have"
#endif
#ifndef RUN
#error "RUN: nodes of a run that is sorted in registers, 8, 12 or 16"
#endif
#ifndef SEGMENT_RULE
#error "SEGMENT_RULE: 0 constant, 1 - exp(-tau h); 1 constant, tau h (eq. 3 as written); 2 linear; 3 cubic"
#endif
#ifndef SHADING
#error "SHADING: 1 lights the colours with the stored normals, 0 does not"
#endif
#ifndef SMOOTH_FACES
#error "SMOOTH_FACES: 1 where the faces hold spline coefficients, 0 where they hold samples"
#endif
#ifndef EXTINCTION
#error "EXTINCTION: 1 if any band has extinction, else 0"
#endif
#ifndef LEVEL_LIGHT
#error "LEVEL_LIGHT: 2 if any level has a sheet, else 1 if any has an impulse, else 0"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/spline.glsl"
#include "lib/optics.glsl"
#include "lib/segment.glsl"
#include "lib/bands.glsl"
#include "lib/octahedral.glsl"
#include "lib/shading.glsl"
#include "lib/lit_segment.glsl"
#include "pass/balanced.glsl"

layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba32f, binding = BINDING_IMAGE) writeonly uniform image2D image;

void main() {
    ivec2 in_tile = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(in_tile, frame.tile_size))) return;
    uint number = pixel_number(in_tile);
    uint head = heads[number];
    ivec2 pixel = frame.tile_origin + in_tile;
    if (!is_broken(head) || !resolve_balanced(pixel, unbroken(head))) return;
    heads[number] = LIST_DONE;
    atomicAdd(counters.balanced_lists, 1u);
    imageStore(image, pixel, pixel_color());
}
