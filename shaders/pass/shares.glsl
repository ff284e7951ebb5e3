// What the work groups of the build pass by compute shaders take of the meshes. Expects pass/interleaved.glsl.

layout(std430, binding = BINDING_SHARES) readonly buffer Shares { Share shares[]; };

uniform uint first_share;
uniform uint share_count;

// What this work group takes; nothing past the last one.
Share this_share() {
    uint group = interleaved_group();
    return group < share_count ? shares[first_share + group] : Share(0u, 0u, 0u);
}
