// Resolve pass, any list: sorts a pixel's list, walks it through the bands and integrates the VRI over the segments, front
// to back; lost crossings are put in. Expects the constants of pass/pixel.glsl, and SORT_CAPACITY.
// Source: Lindholm et al., Algorithm 1 and eqs. 2-3; see lib/segment.glsl. Twin: isosample/integral/data_centric.py

#include "pass/pixel.glsl"
#include "pass/sort_lists.glsl"
#include "pass/gap.glsl"
#include "pass/weigh.glsl"
#include "pass/step.glsl"
#include "pass/span.glsl"

// Length of a list; one that merge_lists.comp has to sort first is only noted.
uint length_if_walked(uint head) {
    uint length = list_length(head);
    if (length > frame.longest_walked) atomicMax(counters.max_depth_complexity, length);
    return length;
}

// Resolves a pixel with the list that begins at `head`.
vec4 resolve_pixel(ivec2 pixel, uint head, uint length) {
    vec3 origin = begin_pixel(pixel);
    vec2 inside = box_of_ray(origin, ray_direction);
    if (is_seen(inside) || frame.box_faces == 0) {
        bool in_array = length <= uint(SORT_CAPACITY);
        if (in_array) sort_into_array(head);
        else if (length <= LINK_SORT_LIMIT) head = sort_links(head, length);
        Node first = Node(LIST_END, 0.0, 0u, 0u);
        Node last = first;
        if (frame.box_faces != 0) {
            first = border_node(inside.x, face_value(origin, inside.x), true);
            last = border_node(inside.y, face_value(origin, inside.y), false);
        }
        walk_list(head, length, in_array, first, last);
    }
    count_list(length);
    if (walk.violations > 0u) {
        atomicAdd(counters.band_violations, walk.violations);
        atomicAdd(counters.repaired_pixels, 1u);
    }
    if (walk.reordered > 0u) atomicAdd(counters.reordered_fragments, walk.reordered);
    if (walk.unplaced > 0u) atomicAdd(counters.unrepaired_pixels, 1u);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return pixel_color();
}
