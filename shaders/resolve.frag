#version 450 core
// Resolve pass, fragment entry (faster on software renderers): one pixel's list to one colour.

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

out vec4 color;

void main() {
    // Lanes outside the tile read zeros for lists on llvmpipe and would walk them until its loop limit (see
    // pass/sort_lists.glsl), which their neighbours in the same vector share.
    if (gl_HelperInvocation) return;
    color = resolve_pixel(ivec2(gl_FragCoord.xy));
}
