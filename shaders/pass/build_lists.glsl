// Build pass: what every entry that appends to the per-pixel lists shares.

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };

// Unnormalised direction of a pixel's ray: its dot product with `forward` is 1.
vec3 pixel_ray(ivec2 pixel) {
    vec2 plane = image_plane_position(pixel, frame.image_size);
    return frame.forward + frame.perspective * (plane.x * frame.span_right + plane.y * frame.span_up);
}
