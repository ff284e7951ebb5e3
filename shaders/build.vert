#version 450 core
// Build pass, vertices: projects the meshes of the isosurfaces. Nothing is clipped by depth: z is 0, and the crossings
// behind the eye are drawn by a second call with side = -1, the point reflection about the eye (same pixels, w > 0).

#ifndef CURVED
#error "CURVED: 1 passes on what the curved surface needs, 0 does not"
#endif
#ifndef RESIDUAL
#error "RESIDUAL: 1 passes on the mesh's error, 0 does not"
#endif

#include "lib/layouts.glsl"

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };

uniform float side;                       // +1 in front of the eye, -1 behind it

in vec3 position;                         // local [world]
in vec3 gradient;                         // of the normalised value, per world unit, times the box radius

out float depth_view;                     // signed distance along the view direction [world]
out vec3 gradient_local;
flat out float corner_depth;             // of one corner of the triangle, see `build.frag`
flat out vec3 corner_gradient;
#if CURVED
out vec3 position_local;
out float moment;                         // gradient . position, see lib/curved.glsl
#endif
#if RESIDUAL
in float residual;                        // how far the field is from the isovalue near this vertex [normalised]
out float residual_value;
flat out float corner_residual;
#endif

void main() {
    vec3 from_eye = position - frame.eye;
    depth_view = dot(from_eye, frame.forward);
    gradient_local = gradient;
    corner_depth = depth_view;
    corner_gradient = gradient;
#if CURVED
    position_local = position;
    moment = dot(gradient, position);
#endif
#if RESIDUAL
    residual_value = residual;
    corner_residual = residual;
#endif
    float w = frame.perspective != 0.0 ? depth_view : 1.0;
    vec2 plane = vec2(dot(from_eye, frame.span_right) * frame.inverse_span_right,
                      dot(from_eye, frame.span_up) * frame.inverse_span_up);
    gl_Position = side * vec4(plane, 0.0, w);
}
