// Resolve pass: sorts a pixel's list, walks it through the bands and integrates the VRI over the segments, front to back.
// Expects the constants SORT_CAPACITY, SEGMENT_RULE and SHADING of the entry file.
// Source: Lindholm et al., Algorithm 1 and eqs. 2-3; see lib/segment.glsl. Twin: isosample/integral/data_centric.py

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_NODES) buffer Nodes { Node nodes[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };
layout(std430, binding = BINDING_BANDS) readonly buffer Bands { Band bands[]; };
layout(std430, binding = BINDING_LEVELS) readonly buffer Levels { Level levels[]; };
layout(std430, binding = BINDING_BOUNDARY) readonly buffer Boundary { float boundary[]; };

vec3 ray_direction;                       // unit, of the pixel being resolved

#include "pass/sort_lists.glsl"
#include "pass/boundary_value.glsl"
#include "pass/node.glsl"
#include "pass/walk.glsl"
#include "pass/gap.glsl"
#include "pass/weigh.glsl"
#include "pass/span.glsl"

// Cuts the visible part of the ray to what is in front of the eye and of every clip plane.
void cut_ray(vec3 origin) {
    walk.visible_start = 0.0;
    walk.visible_end = 1e30;
    for (int i = 0; i < frame.clip_plane_count; ++i) {
        float at_origin = dot(frame.clip_planes[i].xyz, origin) + frame.clip_planes[i].w;
        float along = dot(frame.clip_planes[i].xyz, ray_direction);
        if (along == 0.0) { if (at_origin < 0.0) walk.visible_end = -1e30; }
        else if (along > 0.0) walk.visible_start = max(walk.visible_start, -at_origin / along);
        else walk.visible_end = min(walk.visible_end, -at_origin / along);
    }
}

vec4 resolve_pixel(ivec2 pixel) {
    vec2 plane = image_plane_position(pixel, frame.image_size);
    vec3 offset = plane.x * frame.span_right + plane.y * frame.span_up;
    ray_direction = normalize(frame.forward + frame.perspective * offset);
    vec3 origin = frame.eye + (1.0 - frame.perspective) * offset;
    walk = fresh_walk();
    cut_ray(origin);

    ivec2 in_tile = pixel - frame.tile_origin;
    uint head = heads[in_tile.y * frame.tile_size.x + in_tile.x];
    uint length = list_length(head);
    vec2 inside = box_of_ray(origin);
    // Where nothing is visible, lists may lack crossings (culling.py), and need not be walked.
    bool through_box = inside.x < inside.y && max(inside.x, walk.visible_start) <= min(inside.y, walk.visible_end);
    if (through_box || frame.box_faces == 0) {
        bool in_array = length <= uint(SORT_CAPACITY);
        if (in_array) sort_into_array(head);
        else if (length <= frame.sorted_length) head = sort_links(head, length);
        Node first = Node(LIST_END, 0.0, 0u, 0u);
        Node last = first;
        if (frame.box_faces != 0) {
            first = border_node(inside.x, face_value(origin, inside.x), true);
            last = border_node(inside.y, face_value(origin, inside.y), false);
        }
        walk_list(head, length, in_array, first, last);
    }
    if (length > 0u) {
        atomicAdd(counters.walked_count, length);
        atomicMax(counters.max_depth_complexity, length);
    }
    if (walk.violations > 0u) atomicAdd(counters.band_violations, walk.violations);
    if (walk.reordered > 0u) atomicAdd(counters.reordered_fragments, walk.reordered);
    if (walk.unplaced > 0u) atomicAdd(counters.unrepaired_pixels, 1u);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return vec4(walk.radiance, 1.0 - walk.transmittance) + walk.transmittance * frame.background;
}
