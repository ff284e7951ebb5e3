#version 450 core
// Build pass, isosurfaces: one list node per crossing of the pixel's ray with a surface (Lindholm et al., Algorithm 1, B.2).
// Must be drawn into a framebuffer without attachments: with a colour attachment llvmpipe loses fragments in silence.

#ifndef SHADING
#error "SHADING: 1 stores the unit normal, 0 leaves it out"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/octahedral.glsl"
#include "pass/build_lists.glsl"

uniform uint level;

in float depth_view;
in vec3 gradient_local;

void main() {
    vec3 ray = pixel_ray();
    float scale = length(ray);
    float slope = abs(dot(gradient_local, ray)) / scale;
    uint surface = level | (gl_FrontFacing ? RISING_BIT : 0u) | (packHalf2x16(vec2(slope, 0.0)) << 16);
#if SHADING
    uint normal = pack_normal(gradient_local / max(length(gradient_local), 1e-30));
#else
    uint normal = 0u;
#endif
    append_node(depth_view * scale, surface, normal);
}
