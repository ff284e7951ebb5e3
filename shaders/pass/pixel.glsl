// What the programs of the resolve pass share: buffers, the ray of a pixel, and what is counted.
// Expects the constants SEGMENT_RULE, SHADING, SMOOTH_FACES, EXTINCTION and LEVEL_LIGHT of the entry file.

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };
layout(std430, binding = BINDING_BOUNDARY) readonly buffer Boundary { float boundary[]; };

vec3 ray_direction;                       // unit, of the pixel being resolved

#include "pass/tables.glsl"
#include "pass/pixel_ray.glsl"
#include "pass/nodes.glsl"
#include "pass/boundary_value.glsl"
#include "pass/node.glsl"
#include "pass/walk.glsl"

uint pixel_number(ivec2 in_tile) { return uint(in_tile.y * frame.tile_size.x + in_tile.x); }

// Whether no program of the pass has judged the list with this head yet.
bool is_open(uint head) { return head == LIST_END || head < BROKEN_LIST; }

// Whether a program has found that this is the head of a list that is no chain.
bool is_broken(uint head) { return !is_open(head) && head != LIST_DONE; }

// Head of a list without the note that it is no chain.
uint unbroken(uint head) { return head == LIST_END ? head : head & ~BROKEN_LIST; }

// Begins the walk of a pixel; returns its ray's origin.
vec3 begin_pixel(ivec2 pixel) {
    vec3 offset = pixel_offset(pixel);
    ray_direction = normalize(frame.forward + frame.perspective * offset);
    vec3 origin = frame.eye + (1.0 - frame.perspective) * offset;
    walk = fresh_walk();
    vec2 shown = cut_by_planes(vec2(0.0, 1e30), origin, ray_direction);
    walk.visible_start = shown.x;
    walk.visible_end = shown.y;
    return origin;
}

// Whether something is visible of the ray in the box. Where not, lists may lack crossings (culling.py), and need not be
// walked.
bool is_seen(vec2 inside) {
    return inside.x < inside.y && max(inside.x, walk.visible_start) <= min(inside.y, walk.visible_end);
}

void count_list(uint length) {
    if (length == 0u) return;
    atomicAdd(counters.walked_count, length);
    atomicMax(counters.max_depth_complexity, length);
}

// The pixel's colour where the walk stands.
vec4 pixel_color() { return vec4(walk.radiance, 1.0 - walk.transmittance) + walk.transmittance * frame.background; }
