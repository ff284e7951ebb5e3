#version 450 core
// Count pass: fragments per pixel of a tile, for splitting it into tiles whose lists are known to fit.

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint counts[]; };

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) - frame.tile_origin;
    atomicAdd(counts[pixel.y * frame.tile_size.x + pixel.x], 1u);
}
