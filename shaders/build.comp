#version 450 core
// Build pass by compute shaders, triangles: rasterises one per invocation, small ones faster than the pipeline's set-up of
// triangles does on software renderers. Coverage is that of the pipeline: corners are moved to a grid of 1/256 pixel, edge
// functions are whole numbers, and a centre on an edge belongs to the triangle on one side of it (the top-left rule), so
// that triangles with a common edge never both have a pixel, nor neither of them.

#ifndef SHADING
#error "SHADING: 1 stores the unit normal, 0 leaves it out"
#endif
#ifndef CURVED
#error "CURVED: 1 moves the crossing onto the curved surface, 0 leaves it on the triangle"
#endif
#ifndef RESIDUAL
#error "RESIDUAL: 1 stores the mesh's error in place of the normal, 0 does not"
#endif
#ifndef SUBPIXEL_BITS
#error "SUBPIXEL_BITS: corners are moved to a grid of so many bits of a pixel"
#endif
#ifndef SLOTS
#error "SLOTS: 1 puts crossings into slots of their pixel, 0 into its linked list"
#endif
#ifndef BEYOND_BLOCK
#error "BEYOND_BLOCK: 1 where the slots or nodes take more than a storage block, else 0"
#endif
#ifndef PERSPECTIVE
#error "PERSPECTIVE: 1 interpolates along lines that meet in the eye, 0 along parallel ones"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/octahedral.glsl"
#include "lib/curved.glsl"
#include "pass/build_lists.glsl"
#if SLOTS
#include "pass/append_slot.glsl"
#else
#include "pass/append_node.glsl"
#endif
uint level;
#include "pass/crossing.glsl"
#include "pass/edge_on.glsl"
#include "pass/interleaved.glsl"
#include "pass/shares.glsl"
#include "pass/scan.glsl"

uniform uint window_index;                // first one in the storage block, which may be any corner of a triangle

layout(std430, binding = BINDING_INDICES) readonly buffer Indices { uint indices[]; };
layout(rg32f, binding = BINDING_PLACES) readonly uniform image2D places;
layout(rgba32f, binding = BINDING_CORNERS) readonly uniform image2D corners;
#if CURVED
layout(rgba32f, binding = BINDING_POSITIONS) readonly uniform image2D positions;
#endif
#if RESIDUAL
layout(std430, binding = BINDING_RESIDUALS) readonly buffer Residuals { float residuals[]; };
#endif

const int GRID = 1 << SUBPIXEL_BITS;      // steps of the grid to a pixel

ivec2 texel_of(uint vertex) { return ivec2(vertex % VERTEX_ROW, vertex / VERTEX_ROW); }

// Edge function of a pixel's centre: positive to the left of the edge. Of centres on the edge, those of a left or top edge
// (counterclockwise, y up) count as inside.
int edge_bias(ivec2 edge) { return edge.y < 0 || (edge.y == 0 && edge.x < 0) ? 0 : -1; }
int edge_value(ivec2 edge, ivec2 way) { return edge.x * way.y - edge.y * way.x + edge_bias(edge); }

void main() {
    Share share = this_share();
    if (gl_LocalInvocationID.x >= share.count) return;
    level = share.level;
    uint word = 3u * (share.first + gl_LocalInvocationID.x) - window_index;
    uvec3 vertex = uvec3(indices[word], indices[word + 1u], indices[word + 2u]);
    vec2 place_0 = imageLoad(places, texel_of(vertex.x)).xy;
    vec2 place_1 = imageLoad(places, texel_of(vertex.y)).xy;
    vec2 place_2 = imageLoad(places, texel_of(vertex.z)).xy;
    if (max(place_0.x, max(place_1.x, place_2.x)) == NOT_IN_PICTURE) {
        vec3 xs = vec3(place_0.x, place_1.x, place_2.x);
        vec3 ys = vec3(place_0.y, place_1.y, place_2.y);
        bool behind = all(equal(xs, vec3(NOT_IN_PICTURE))) && all(equal(ys, vec3(1.0)));
        if (!behind) atomicAdd(counters.unsuited, 1u);
        return;
    }
    ivec2 p0 = ivec2(round(place_0 * float(GRID)));
    ivec2 p1 = ivec2(round(place_1 * float(GRID)));
    ivec2 p2 = ivec2(round(place_2 * float(GRID)));
    ivec2 low = min(p0, min(p1, p2)), high = max(p0, max(p1, p2));
    // Pixels whose centres lie in the box around the triangle, and in the tile.
    ivec2 first = max((low + GRID / 2 - 1) >> SUBPIXEL_BITS, frame.tile_origin);
    ivec2 last = min((high - GRID / 2) >> SUBPIXEL_BITS, frame.tile_origin + frame.tile_size - 1);
    if (first.x > last.x || first.y > last.y) return;
    ivec2 extent = high - low;
    if (max(extent.x, extent.y) > LARGEST_TRIANGLE * GRID) {
        atomicAdd(counters.unsuited, 1u);
        return;
    }
    ivec2 side_1 = p1 - p0, side_2 = p2 - p0;
    int area = side_1.x * side_2.y - side_1.y * side_2.x;
    if (area == 0) return;
    bool rising = area > 0;               // seen from its front
    int turn = rising ? 1 : -1;
    ivec2 edge_0 = turn * (p2 - p1), edge_1 = turn * (p0 - p2), edge_2 = turn * (p1 - p0);
    ivec2 centre = GRID * first + GRID / 2;
    ivec3 row = ivec3(edge_value(edge_0, centre - p1), edge_value(edge_1, centre - p2), edge_value(edge_2, centre - p0));
    ivec3 along_x = -GRID * ivec3(edge_0.y, edge_1.y, edge_2.y);
    ivec3 along_y = GRID * ivec3(edge_0.x, edge_1.x, edge_2.x);

    // Weights of the second and the third corner: from where they are, not from where the grid has them, so that a centre may
    // lie a little beside the triangle.
    vec2 way_1 = place_1 - place_0, way_2 = place_2 - place_0;
    float size = way_1.x * way_2.y - way_1.y * way_2.x;
    float inverse = size != 0.0 ? 1.0 / size : 0.0;
    vec4 corner_0 = imageLoad(corners, texel_of(vertex.x));
    vec4 corner_1 = imageLoad(corners, texel_of(vertex.y));
    vec4 corner_2 = imageLoad(corners, texel_of(vertex.z));
#if CURVED
    vec4 position_0 = imageLoad(positions, texel_of(vertex.x));
    vec4 position_1 = imageLoad(positions, texel_of(vertex.y));
    vec4 position_2 = imageLoad(positions, texel_of(vertex.z));
#endif
#if RESIDUAL
    vec3 residual = vec3(residuals[vertex.x], residuals[vertex.y], residuals[vertex.z]);
#endif
#if PERSPECTIVE
    vec3 near = 1.0 / vec3(corner_0.w, corner_1.w, corner_2.w);    // what runs linearly in the picture
    vec2 rise = vec2(near.y - near.x, near.z - near.x);
#else
    vec2 rise = vec2(corner_1.w - corner_0.w, corner_2.w - corner_0.w);
    vec3 ray = frame.forward;
#endif
    float change = inverse == 0.0 ? 1e30 : abs(inverse) * (abs(way_2.y * rise.x - way_1.y * rise.y) + abs(way_1.x * rise.y - way_2.x * rise.x));
    Scan scan = Scan(row, row, along_x, along_y, 1.0 / vec3(along_x), last.x - first.x, 0, -1, first.y - 1);
    uint found_count = 0u;
    do {
        to_next_pixel(scan, last.y);
        ivec2 pixel = ivec2(first.x + scan.column, scan.y);
        ivec3 value = scan.row + scan.column * along_x;
        if ((value.x | value.y | value.z) >= 0 && scan.y <= last.y) {
            vec2 way = vec2(pixel) + 0.5 - place_0;
            float second = (way.x * way_2.y - way.y * way_2.x) * inverse;
            float third = (way_1.x * way.y - way_1.y * way.x) * inverse;
            float within_second = clamp(second, 0.0, 1.0);
            float within_third = clamp(third, 0.0, 1.0 - within_second);
#if PERSPECTIVE
            vec3 ray = pixel_ray(pixel);
            float depth = 1.0 / (near.x + within_second * rise.x + within_third * rise.y);
            bool edge_on = is_edge_on(change * depth * depth, length(ray));
#else
            bool edge_on = is_edge_on(change, 1.0);
#endif
            second = edge_on ? within_second : second;      // beside a triangle seen from its edge there may be anything
            third = edge_on ? within_third : third;
#if PERSPECTIVE
            depth = 1.0 / (near.x + second * rise.x + third * rise.y);
            second *= near.y * depth;
            third *= near.z * depth;
#endif
            vec4 corner = corner_0 + second * (corner_1 - corner_0) + third * (corner_2 - corner_0);
            Crossing found = no_crossing();
            found.gradient = corner.xyz;
            found.depth = corner.w;
#if CURVED
            vec4 position = position_0 + second * (position_1 - position_0) + third * (position_2 - position_0);
            found.position = position.xyz;
            found.moment = position.w;
            found.curved = !edge_on;
#endif
#if RESIDUAL
            found.residual = residual.x + second * (residual.y - residual.x) + third * (residual.z - residual.x);
#endif
            append_crossing(pixel, ray, found, rising);
            ++found_count;
        }
    } while (scan.y <= last.y);
    if (scan.y <= last.y) atomicAdd(counters.unsuited, 1u);   // the driver ended the loops
    if (found_count > 0u && atomicAdd(counters.rasterised, found_count) + found_count < found_count) {
        atomicAdd(counters.unsuited, 1u);  // more than 2^32 fragments
    }
}
