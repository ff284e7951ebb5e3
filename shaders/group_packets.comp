#version 450 core
// Between build and resolve pass, lists in slots: groups packets of pixels by the longest of their lists, so that each is
// resolved by one program, which loads no more than that.

#include "lib/layouts.glsl"

layout(local_size_x = 64) in;
layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) readonly buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };
// How many packets each class has, then the packets of one class after the other, with room for all of them in each; then the
// pixels whose lists are no chains.
layout(std430, binding = BINDING_PACKETS) buffer Packets { uint packets[]; };

#include "pass/packets.glsl"

void main() {
    uint packet = gl_GlobalInvocationID.x;
    if (packet >= packet_total()) return;
    uint longest = 0u;
    uint sum = 0u;
    for (uint place = 0u; place < PACKET_PIXELS; ++place) {
        ivec2 in_tile = packet_pixel(packet, place);
        if (all(lessThan(in_tile, frame.tile_size))) {
            uint count = heads[in_tile.y * frame.tile_size.x + in_tile.x] + 1u;
            longest = max(longest, count);
            sum += count;
        }
    }
    uint group = class_of(longest);       // lists longer than the last class takes are not resolved
    uint number = atomicAdd(packets[group], 1u);
    packets[class_start(group) + number] = packet;
    if (sum == 0u) return;
    atomicAdd(counters.node_count, sum);
    atomicMax(counters.max_depth_complexity, longest);
}
