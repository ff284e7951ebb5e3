#version 450 core
// Build pass, isosurfaces: one list node per crossing of the pixel's ray with a surface (Lindholm et al., Algorithm 1, B.2).
// Must be drawn into a framebuffer without attachments: with a colour attachment llvmpipe loses fragments in silence.

#ifndef SHADING
#error "SHADING: 1 stores the unit normal, 0 leaves it out"
#endif
#ifndef SUBPIXEL_BITS
#error "SUBPIXEL_BITS: to how many bits of a pixel the rasteriser rounds the vertices"
#endif
#ifndef CURVED
#error "CURVED: 1 moves the crossing onto the curved surface, 0 leaves it on the triangle"
#endif
#ifndef RESIDUAL
#error "RESIDUAL: 1 stores the mesh's error in place of the normal, 0 does not"
#endif
#ifndef BEYOND_BLOCK
#error "BEYOND_BLOCK: 1 where the nodes take more than a storage block, else 0"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/octahedral.glsl"
#include "lib/curved.glsl"
#include "pass/build_lists.glsl"
#include "pass/append_node.glsl"
uniform uint level;
#include "pass/crossing.glsl"
#include "pass/edge_on.glsl"

in float depth_view;
in vec3 gradient_local;
flat in float corner_depth;
flat in vec3 corner_gradient;
#if CURVED
in vec3 position_local;
in float moment;
#endif
#if RESIDUAL
in float residual_value;
flat in float corner_residual;
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 ray = pixel_ray(pixel);
    Crossing found = no_crossing();
    bool edge_on = is_edge_on(fwidth(depth_view), length(ray));   // then one of the corners is nearer the truth
    found.gradient = edge_on ? corner_gradient : gradient_local;
    found.depth = edge_on ? corner_depth : depth_view;
#if CURVED
    found.position = position_local;
    found.moment = moment;
    found.curved = !edge_on;
#endif
#if RESIDUAL
    found.residual = edge_on ? corner_residual : residual_value;
#endif
    append_crossing(pixel, ray, found, gl_FrontFacing);
}
