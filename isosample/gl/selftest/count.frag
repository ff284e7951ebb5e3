#version 450 core
// Each fragment counts itself and adds one to its pixel's cell.

#ifndef IMAGE_WIDTH
#error "pixels in a row"
#endif

layout(std430, binding = 0) buffer Counts {
    uint total;
    uint cells[];
};

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    atomicAdd(total, 1u);
    atomicAdd(cells[pixel.y * IMAGE_WIDTH + pixel.x], 1u);
}
