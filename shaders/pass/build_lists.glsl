// Build pass: what every entry that appends to the per-pixel lists shares.

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };

#include "pass/nodes.glsl"

// Unnormalised direction of a pixel's ray: its dot product with `forward` is 1.
vec3 pixel_ray(ivec2 pixel) {
    vec2 plane = image_plane_position(pixel, frame.image_size);
    return frame.forward + frame.perspective * (plane.x * frame.span_right + plane.y * frame.span_up);
}

// Appends one node to a pixel's list. Past the capacity nothing is written, but the node is counted: the host sees
// node_count > node_capacity and never shows such a frame.
void append_node(ivec2 pixel, float distance, uint surface, uint normal) {
    uint index = atomicAdd(counters.node_count, 1u);
    if (index >= frame.node_capacity) return;
    ivec2 place = pixel - frame.tile_origin;
    uint next = atomicExchange(heads[place.y * frame.tile_size.x + place.x], index);
    store_node(index, Node(next, distance, surface, normal));
}
