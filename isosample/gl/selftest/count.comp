#version 450 core
// Each invocation counts itself and adds one to its own cell.

layout(local_size_x = 64) in;
layout(std430, binding = 0) buffer Counts {
    uint total;
    uint cells[];
};

void main() {
    atomicAdd(total, 1u);
    atomicAdd(cells[gl_GlobalInvocationID.x], 1u);
}
