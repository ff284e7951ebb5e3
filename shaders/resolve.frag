#version 450 core
// Resolve pass, any list, fragment entry (faster on software renderers): one pixel's list to one colour.

#ifndef SORT_CAPACITY
#error "SORT_CAPACITY: longest list that is sorted in a local array"
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
#include "pass/resolve.glsl"

out vec4 color;

void main() {
    // Lanes outside the tile read zeros for lists on llvmpipe and would walk them until its loop limit (see
    // pass/sort_lists.glsl), which their neighbours in the same vector share.
    if (gl_HelperInvocation) return;
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    uint number = pixel_number(pixel - frame.tile_origin);
    if (heads[number] == LIST_DONE) discard;
    uint head = unbroken(heads[number]);
    uint length = length_if_walked(head);
    if (length > frame.longest_walked) discard;
    color = resolve_pixel(pixel, head, length);
    heads[number] = LIST_DONE;
}
