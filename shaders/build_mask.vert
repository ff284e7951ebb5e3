#version 450 core
// Build pass, vertices of the border of the valid cells: two triangles per cell face, one instance per face. Shared
// corners come out bit-identical: the same expression of the same integers.

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };

uniform float side;                       // +1 in front of the eye, -1 behind it

in vec3 start;                            // lowest corner of the face [sample index]
in int face;                              // 2 * axis, + 1 if the valid cell is on the lower side
in vec4 values;                           // normalised, at the corners, the lower of the face's two axes fastest

out float depth_view;                     // signed distance along the view direction [world]
flat out float corner_depth;             // of one corner of the triangle
out vec2 part;                            // position on the face, in [0, 1]
flat out vec4 corner_values;
flat out int cell_face;

const vec2 CORNERS[6] = vec2[](vec2(0, 0), vec2(1, 0), vec2(1, 1), vec2(0, 0), vec2(1, 1), vec2(0, 1));

void main() {
    int axis = face / 2;
    part = CORNERS[gl_VertexID];
    vec3 index = start;
    index[axis == 0 ? 1 : 0] += part.x;
    index[axis == 2 ? 1 : 2] += part.y;
    precise vec3 position = frame.first_sample.xyz + index.x * frame.step_x.xyz + index.y * frame.step_y.xyz
        + index.z * frame.step_z.xyz;
    corner_values = values;
    cell_face = face;
    vec3 from_eye = position - frame.eye;
    depth_view = dot(from_eye, frame.forward);
    corner_depth = depth_view;
    float w = frame.perspective != 0.0 ? depth_view : 1.0;
    vec2 plane = vec2(dot(from_eye, frame.span_right) * frame.inverse_span_right,
                      dot(from_eye, frame.span_up) * frame.inverse_span_up);
    gl_Position = side * vec4(plane, 0.0, w);
}
