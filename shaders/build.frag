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

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/octahedral.glsl"
#include "lib/curved.glsl"
#include "pass/build_lists.glsl"
#include "pass/edge_on.glsl"

uniform uint level;

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
    vec3 ray = pixel_ray();
    float scale = length(ray);
    bool edge_on = is_edge_on(depth_view, scale);   // then one of the corners is nearer the truth
    vec3 gradient = edge_on ? corner_gradient : gradient_local;
    float along = dot(gradient, ray) / scale;
    float distance = (edge_on ? corner_depth : depth_view) * scale;
#if CURVED
    float error = curved_error(gradient_local, position_local, moment);
    if (!edge_on) distance += curved_shift(error, along, length(gradient), frame.curved_limit, gl_FrontFacing);
#endif
    uint surface = level | (gl_FrontFacing ? RISING_BIT : 0u) | (packHalf2x16(vec2(min(abs(along), LARGEST_HALF), 0.0)) << 16);
#if RESIDUAL
    uint normal = floatBitsToUint(edge_on ? corner_residual : residual_value);
#elif SHADING
    float steepness = length(gradient);
    uint normal = steepness > 0.0 ? pack_normal(gradient / steepness) : NO_NORMAL;
#else
    uint normal = NO_NORMAL;
#endif
    append_node(distance, surface, normal);
}
