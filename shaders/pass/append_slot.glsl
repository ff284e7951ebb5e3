// Build pass into slots. Expects pass/build_lists.glsl and the constants SHADING and BEYOND_BLOCK.

#include "pass/packets.glsl"
#include "pass/slots.glsl"

// The slots, as many of them as a storage block holds: software renderers store both words of a crossing in one turn there, but one
// after the other in an image.
layout(std430, binding = BINDING_SLOT_STORE) writeonly buffer SlotStore { uvec2 slot_store[]; };

uniform uint slot_count;                  // of a pixel

// Puts a crossing into a pixel's next slot. Past the last nothing is written, but the crossing is counted: the host sees that
// a list is longer than there are slots, and never shows such a frame.
void append_node(ivec2 pixel, float distance, uint surface, uint normal) {
    ivec2 in_tile = pixel - frame.tile_origin;
    uint number = atomicAdd(heads[in_tile.y * frame.tile_size.x + in_tile.x], 1u) + 1u;
    if (number >= slot_count) return;
    int texel = slot_place(packet_of(in_tile), number, place_of(in_tile));
#if BEYOND_BLOCK
    if (texel >= slot_store.length()) imageStore(slots, texel, uvec4(floatBitsToUint(distance), surface, 0u, 0u));
    else
#endif
    slot_store[texel] = uvec2(floatBitsToUint(distance), surface);
#if SHADING
    imageStore(slot_normals, texel, uvec4(normal, 0u, 0u, 0u));
#endif
}
