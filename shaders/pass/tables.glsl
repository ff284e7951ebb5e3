// The bands and levels of a scene, as texels: software renderers load these several times faster than the members of a storage
// block. Those of a band stand before those of the level at its upper end.

layout(rgba32f, binding = BINDING_TABLE) readonly uniform image2D scene_table;

vec4 table_texel(int index, int part) {
    return imageLoad(scene_table, ivec2((index % TABLE_ROW) * TABLE_TEXELS + part, index / TABLE_ROW));
}

Band band_at(int index) {
    vec4 values = table_texel(index, 2);
    return Band(table_texel(index, 0), table_texel(index, 1), values.x, values.y, values.z, values.w);
}

Level level_at(int index) { return Level(table_texel(index, 3), table_texel(index, 4)); }
