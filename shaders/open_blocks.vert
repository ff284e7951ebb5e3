#version 450 core
// Points that cover the blocks of pixels in which a program of the resolve pass has something to do: software renderers run a
// shader to its end for pixels that it discards at once. One vertex per block of the tile, row by row.

#ifndef TAKES
#error "TAKES: 0 lists that no program has judged yet, 1 those that are no chains, 2 all that are left"
#endif

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };

void main() {
    ivec2 first = frame.tile_origin / RESOLVE_BLOCK;
    int columns = (frame.tile_origin.x + frame.tile_size.x - 1) / RESOLVE_BLOCK - first.x + 1;
    ivec2 corner = RESOLVE_BLOCK * (first + ivec2(gl_VertexID % columns, gl_VertexID / columns));
    ivec2 low = max(corner, frame.tile_origin) - frame.tile_origin;
    ivec2 high = min(corner + RESOLVE_BLOCK, frame.tile_origin + frame.tile_size) - frame.tile_origin;
    bool found = false;
    for (int y = low.y; y < high.y; ++y) {
        for (int x = low.x; x < high.x; ++x) {
            uint head = heads[y * frame.tile_size.x + x];
            bool open = head == LIST_END || head < BROKEN_LIST;
            found = found || (head != LIST_DONE && (TAKES == 2 || open == (TAKES == 0)));
        }
    }
    vec2 blocks = vec2((frame.image_size + RESOLVE_BLOCK - 1) / RESOLVE_BLOCK);  // the viewport
    vec2 centre = (vec2(corner / RESOLVE_BLOCK) + 0.5) / blocks;
    gl_Position = found ? vec4(2.0 * centre - 1.0, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = float(RESOLVE_BLOCK);
}
