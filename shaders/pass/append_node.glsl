// Build pass into linked lists. Expects pass/build_lists.glsl and the constant BEYOND_BLOCK.

#include "pass/nodes.glsl"
#include "pass/new_node.glsl"

// Appends one node to a pixel's list. Past the capacity nothing is written, but the node is counted: the host sees
// node_count > node_capacity and never shows such a frame.
void append_node(ivec2 pixel, float distance, uint surface, uint normal) {
    uint index = atomicAdd(counters.node_count, 1u);
    if (index >= frame.node_capacity) return;
    ivec2 place = pixel - frame.tile_origin;
    uint next = atomicExchange(heads[place.y * frame.tile_size.x + place.x], index);
    store_new_node(index, Node(next, distance, surface, normal));
}
