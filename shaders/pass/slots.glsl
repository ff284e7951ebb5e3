// Slots: a pixel's crossings at places that follow from the pixel and their number, in place of a linked list: none has to be
// loaded before it is known where the next one is, and those of the same number lie together, packet by packet.
// Heads hold how many crossings a pixel has, less one, so that LIST_END is none.
// Expects `frame`, pass/packets.glsl and the constant SHADING.

layout(rg32ui, binding = BINDING_SLOTS) uniform uimageBuffer slots;   // distance and surface, as in struct Node
#if SHADING
layout(r32ui, binding = BINDING_SLOT_NORMALS) uniform uimageBuffer slot_normals;
#endif

// Where the crossing of a number is, of the pixel at a place of a packet.
int slot_place(uint packet, uint number, uint place) {
    return int((number * packet_total() + packet) * PACKET_PIXELS + place);
}
