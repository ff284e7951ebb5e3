#version 450 core
// Points that cover the blocks of pixels whose rays may see something: software renderers run a shader to its end for pixels
// that it leaves at once. One vertex per block of the tile, row by row.

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(binding = UNIT_SPANS) uniform sampler2D spans;

void main() {
    ivec2 first = frame.tile_origin / RAY_BLOCK;
    int columns = (frame.tile_origin.x + frame.tile_size.x - 1) / RAY_BLOCK - first.x + 1;
    ivec2 block = first + ivec2(gl_VertexID % columns, gl_VertexID / columns);
    vec2 span = texelFetch(spans, block, 0).xy;
    vec2 blocks = vec2((frame.image_size + RAY_BLOCK - 1) / RAY_BLOCK);  // the viewport
    vec2 centre = (vec2(block) + 0.5) / blocks;
    gl_Position = span.x < span.y ? vec4(2.0 * centre - 1.0, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = float(RAY_BLOCK);
}
