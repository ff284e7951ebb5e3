// The fragment pool: nodes of lists as texels, which software renderers load several times faster than the members of a
// storage block.

layout(rgba32ui, binding = BINDING_NODES) uniform uimageBuffer nodes;

uvec4 node_texel(Node node) { return uvec4(node.next_index, floatBitsToUint(node.distance), node.surface, node.normal); }

Node load_node(uint index) {
    uvec4 texel = imageLoad(nodes, int(index));
    return Node(texel.x, uintBitsToFloat(texel.y), texel.z, texel.w);
}

void store_node(uint index, Node node) { imageStore(nodes, int(index), node_texel(node)); }

uint next_node(uint index) { return load_node(index).next_index; }

void link_node(uint index, uint next) {
    Node node = load_node(index);
    node.next_index = next;
    store_node(index, node);
}
