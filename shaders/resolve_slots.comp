#version 450 core
// Resolve pass, lists in slots, those that are chains: one pixel's list to one colour, for the packets of one class of length.

#ifndef RUN
#error "RUN: nodes of a run that is sorted in registers, 8, 12 or 16"
#endif
#ifndef RUNS
#error "RUNS: how many runs a list may have; 0: none, it is empty"
#endif
#ifndef FACE_BAND
#error "FACE_BAND: the band of all values on the faces of the box if nothing is visible in it, else -1"
#endif
#ifndef SEGMENT_RULE
#error "SEGMENT_RULE: 0 constant, 1 - exp(-tau h); 1 constant, tau h (eq. 3 as written); 2 linear; 3 cubic"
#endif
#ifndef SHADING
#error "SHADING: 1 lights the colours with the stored normals, 0 does not"
#endif
#ifndef SMOOTH_FACES
#error "SMOOTH_FACES: 1 where the faces hold spline coefficients, 0 where they hold samples"
#endif
#ifndef EXTINCTION
#error "EXTINCTION: 1 if any band has extinction, else 0"
#endif
#ifndef LEVEL_LIGHT
#error "LEVEL_LIGHT: 2 if any level has a sheet, else 1 if any has an impulse, else 0"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/spline.glsl"
#include "lib/optics.glsl"
#include "lib/segment.glsl"
#include "lib/bands.glsl"
#include "lib/octahedral.glsl"
#include "lib/shading.glsl"
#include "lib/lit_segment.glsl"
#include "pass/chain.glsl"
#include "pass/slot_chain.glsl"
#include "pass/interleaved.glsl"

layout(rgba32f, binding = BINDING_IMAGE) writeonly uniform image2D image;
layout(std430, binding = BINDING_PACKETS) buffer Packets { uint packets[]; };

uniform uint first_packet;                // in the buffer
uniform uint packet_number;               // how many

void main() {
    uint invocation = interleaved_invocation();
    uint number = invocation / PACKET_PIXELS;
    if (number >= packet_number) return;
    uint packet = packets[first_packet + number];
    uint place = invocation % PACKET_PIXELS;
    ivec2 in_tile = packet_pixel(packet, place);
    if (any(greaterThanEqual(in_tile, frame.tile_size))) return;
    uint length = heads[pixel_number(in_tile)] + 1u;
    ivec2 pixel = frame.tile_origin + in_tile;
    if (resolve_slots(pixel, packet, place, length)) {
        imageStore(image, pixel, pixel_color());
        heads[pixel_number(in_tile)] = LIST_DONE;
    } else {
        uint broken = atomicAdd(counters.broken_chains, 1u);
        packets[broken_start() + broken] = pixel_number(in_tile);
        atomicAdd(counters.broken_nodes, length);
    }
}
