// Packets of 4 x 2 pixels of a tile, row by row. Expects `frame`.

uint packet_columns() { return uint((frame.tile_size.x + PACKET_WIDTH - 1) / PACKET_WIDTH); }

uint packet_total() { return packet_columns() * uint((frame.tile_size.y + PACKET_HEIGHT - 1) / PACKET_HEIGHT); }

// A pixel of the tile by its packet and its place in it; one in the last column or row of packets may lie beside the tile.
ivec2 packet_pixel(uint packet, uint place) {
    uint columns = packet_columns();
    ivec2 corner = ivec2(packet % columns, packet / columns) * ivec2(PACKET_WIDTH, PACKET_HEIGHT);
    return corner + ivec2(place % uint(PACKET_WIDTH), place / uint(PACKET_WIDTH));
}

// The reverse.
uint packet_of(ivec2 in_tile) {
    return uint(in_tile.y / PACKET_HEIGHT) * packet_columns() + uint(in_tile.x / PACKET_WIDTH);
}

uint place_of(ivec2 in_tile) {
    return uint(in_tile.y % PACKET_HEIGHT) * uint(PACKET_WIDTH) + uint(in_tile.x % PACKET_WIDTH);
}

// Class of a packet by its longest list.
uint class_of(uint longest) {
    return uint(longest > 0u) + uint(longest > 8u) + uint(longest > 12u) + uint(longest > 16u) + uint(longest > 24u)
         + uint(longest > 32u) + uint(longest > 48u) + uint(longest > 64u) + uint(longest > 96u) + uint(longest > 128u)
         + uint(longest > 192u);
}

// Where in their buffer the packets of a class are, and the pixels whose lists are no chains.
uint class_start(uint number) { return PACKET_CLASSES + number * packet_total(); }

uint broken_start() { return class_start(PACKET_CLASSES); }
