#version 450 core
// Resolve pass, lists in slots: makes linked lists of those that are no chains, for the programs that take any list.

#ifndef SHADING
#error "SHADING: 1 keeps the normals, 0 does not"
#endif
#ifndef BEYOND_BLOCK
#error "BEYOND_BLOCK: 1 where the nodes take more than a storage block, else 0"
#endif

#include "lib/layouts.glsl"

layout(local_size_x = 64) in;
layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };
layout(std430, binding = BINDING_PACKETS) readonly buffer Packets { uint packets[]; };

#include "pass/nodes.glsl"
#include "pass/new_node.glsl"
#include "pass/packets.glsl"
#include "pass/slots.glsl"

void main() {
    if (gl_GlobalInvocationID.x >= counters.broken_chains) return;
    uint pixel = packets[broken_start() + gl_GlobalInvocationID.x];
    uint length = heads[pixel] + 1u;
    if (length == 0u) return;             // an empty list is one already
    ivec2 in_tile = ivec2(pixel % uint(frame.tile_size.x), pixel / uint(frame.tile_size.x));
    uint first = atomicAdd(counters.spilled, length);
    uint number = 0u;
    do {
        int texel = slot_place(packet_of(in_tile), number, place_of(in_tile));
        uvec2 slot = imageLoad(slots, texel).xy;
#if SHADING
        uint normal = imageLoad(slot_normals, texel).x;
#else
        uint normal = NO_NORMAL;
#endif
        uint next = number + 1u < length ? first + number + 1u : LIST_END;
        store_new_node(first + number, Node(next, uintBitsToFloat(slot.x), slot.y, normal));
        ++number;
    } while (number < length);
    heads[pixel] = first | BROKEN_LIST;
}
