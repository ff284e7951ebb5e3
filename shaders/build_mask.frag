#version 450 core
// Build pass, border of the valid cells: one list node where the pixel's ray enters or leaves them, with the value there.

#ifndef SUBPIXEL_BITS
#error "SUBPIXEL_BITS: to how many bits of a pixel the rasteriser rounds the vertices"
#endif
#ifndef BEYOND_BLOCK
#error "BEYOND_BLOCK: 1 where the nodes take more than a storage block, else 0"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "pass/build_lists.glsl"
#include "pass/append_node.glsl"
#include "pass/edge_on.glsl"

in float depth_view;
flat in float corner_depth;
in vec2 part;
flat in vec4 corner_values;
flat in int cell_face;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 ray = pixel_ray(pixel);
    int axis = cell_face / 2;
    vec3 upwards = axis == 0 ? frame.unit_row_x.xyz : (axis == 1 ? frame.unit_row_y.xyz : frame.unit_row_z.xyz);
    bool valid_below = cell_face % 2 == 1;
    bool entering = (dot(upwards, ray) > 0.0) != valid_below;
    float value = bilinear(corner_values, clamp(part.x, 0.0, 1.0), clamp(part.y, 0.0, 1.0));
    uint tolerance = packHalf2x16(vec2(face_tolerance(corner_values), 0.0)) << 16;
    uint surface = DOMAIN_LEVEL | (entering ? RISING_BIT : 0u) | tolerance;
    float scale = length(ray);
    float depth = is_edge_on(fwidth(depth_view), scale) ? corner_depth : depth_view;
    append_node(pixel, depth * scale, surface, floatBitsToUint(value));
}
