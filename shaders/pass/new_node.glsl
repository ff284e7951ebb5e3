// New nodes of the fragment pool. Expects pass/nodes.glsl and the constant BEYOND_BLOCK. What stores them may not load them
// in the same call.

// The nodes, as many of them as a storage block holds: software renderers store all four words of one in one turn there, but one after
// the other in an image.
layout(std430, binding = BINDING_NODE_STORE) writeonly buffer NodeStore { uvec4 node_store[]; };

void store_new_node(uint index, Node node) {
#if BEYOND_BLOCK
    if (index >= node_store.length()) store_node(index, node);
    else
#endif
    node_store[index] = node_texel(node);
}
