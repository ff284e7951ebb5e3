#version 450 core
// One merge pass over every list that is longer than LINK_SORT_LIMIT; called for run = 1, 2, 4, ... until the longest
// list is sorted. See pass/sort_lists.glsl.

#ifndef SORT_CAPACITY
#error "SORT_CAPACITY: longest list that is sorted in a local array (not used here)"
#endif

#include "lib/layouts.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };

#include "pass/nodes.glsl"
#include "pass/sort_lists.glsl"

uniform uint run;

void main() {
    ivec2 in_tile = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(in_tile, frame.tile_size))) return;
    int pixel = in_tile.y * frame.tile_size.x + in_tile.x;
    uint head = heads[pixel];
    if (head == LIST_DONE || head == LIST_END) return;
    head &= ~BROKEN_LIST;
    if (list_length(head) > LINK_SORT_LIMIT) heads[pixel] = merge_runs(head, run);
}
