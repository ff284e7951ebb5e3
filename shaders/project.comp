#version 450 core
// Build pass by compute shaders, vertices: where they are in the picture, and what triangles interpolate.

#ifndef CURVED
#error "CURVED: 1 passes on what the curved surface needs, 0 does not"
#endif

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_VERTICES) readonly buffer Vertices { float vertices[]; };   // position, gradient
layout(rg32f, binding = BINDING_PLACES) writeonly uniform image2D places;
layout(rgba32f, binding = BINDING_CORNERS) writeonly uniform image2D corners;
#if CURVED
layout(rgba32f, binding = BINDING_POSITIONS) writeonly uniform image2D positions;
#endif

#include "pass/interleaved.glsl"
#include "pass/shares.glsl"

uniform uint window_vertex;               // first one in the storage block: of large buffers it shows a part

const float FARTHEST = 4194304.0;         // [pixel]: beyond, 1/256 of a pixel times 2^31 is near

void main() {
    Share share = this_share();
    if (gl_LocalInvocationID.x >= share.count) return;
    uint number = share.first + gl_LocalInvocationID.x;
    uint word = 6u * (number - window_vertex);
    vec3 position = vec3(vertices[word], vertices[word + 1u], vertices[word + 2u]);
    vec3 gradient = vec3(vertices[word + 3u], vertices[word + 4u], vertices[word + 5u]);
    vec3 from_eye = position - frame.eye;
    float depth = dot(from_eye, frame.forward);
    float w = frame.perspective != 0.0 ? depth : 1.0;
    vec2 plane = vec2(dot(from_eye, frame.span_right) * frame.inverse_span_right,
                      dot(from_eye, frame.span_up) * frame.inverse_span_up) / w;
    vec2 pixel = (0.5 * plane + 0.5) * vec2(frame.image_size);
    bool inside = max(abs(pixel.x), abs(pixel.y)) < FARTHEST;
    vec2 place = w > 0.0 && inside ? pixel : vec2(NOT_IN_PICTURE, w > 0.0 ? 0.0 : 1.0);
    ivec2 texel = ivec2(number % VERTEX_ROW, number / VERTEX_ROW);
    imageStore(places, texel, vec4(place, 0.0, 0.0));
    imageStore(corners, texel, vec4(gradient, depth));
#if CURVED
    imageStore(positions, texel, vec4(position, dot(gradient, position)));
#endif
}
