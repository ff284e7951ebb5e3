#version 450 core
// One triangle that covers the image: corners (-1, -1), (3, -1), (-1, 3) in normalised device coordinates.

void main() {
    vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}
