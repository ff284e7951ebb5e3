#version 450 core
// Ray caster, before the rays: how far all rays of a block of pixels run through empty macrocells, from the front and from
// behind. One fragment per block.

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "pass/ray_block.glsl"

out vec2 span;

void main() { span = gl_HelperInvocation ? NOTHING_SEEN : block_span(ivec2(gl_FragCoord.xy)); }
