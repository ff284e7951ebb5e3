// The fragment pool: nodes of lists as texels, which software renderers load and store several times faster than the members
// of a storage block. A node's index counts along the rows.

layout(rgba32ui, binding = BINDING_NODES) uniform uimage2D nodes;

ivec2 node_place(uint index) { return ivec2(index % NODE_ROW, index / NODE_ROW); }

Node load_node(uint index) {
    uvec4 texel = imageLoad(nodes, node_place(index));
    return Node(texel.x, uintBitsToFloat(texel.y), texel.z, texel.w);
}

void store_node(uint index, Node node) {
    imageStore(nodes, node_place(index), uvec4(node.next_index, floatBitsToUint(node.distance), node.surface, node.normal));
}

uint next_node(uint index) { return load_node(index).next_index; }

void link_node(uint index, uint next) {
    Node node = load_node(index);
    node.next_index = next;
    store_node(index, node);
}
