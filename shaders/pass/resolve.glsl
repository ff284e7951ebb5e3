// Resolve pass: sorts a pixel's list, walks it through the bands and integrates the VRI over the segments, front to back.
// Expects the constants SORT_CAPACITY, SEGMENT_RULE and SHADING of the entry file.
// Source: Lindholm et al., Algorithm 1 and eqs. 2-3. Twin: isosample/integral/data_centric.py

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std430, binding = BINDING_HEADS) buffer Heads { uint heads[]; };
layout(std430, binding = BINDING_NODES) buffer Nodes { Node nodes[]; };
layout(std430, binding = BINDING_COUNTERS) buffer CounterBlock { Counters counters; };
layout(std430, binding = BINDING_BANDS) readonly buffer Bands { Band bands[]; };
layout(std430, binding = BINDING_IMPULSES) readonly buffer Impulses { vec4 impulses[]; };
layout(std430, binding = BINDING_BOUNDARY) readonly buffer Boundary { float boundary[]; };

vec3 ray_direction;                       // unit, of the pixel being resolved

#include "pass/sort_lists.glsl"
#include "pass/boundary_value.glsl"

struct Walk {
    vec3 radiance;                        // premultiplied, in front of the current position
    float transmittance;
    float visible_start, visible_end;     // the part of the ray that is not cut away [world]
    float distance;                       // front end of the current segment [world]
    float position;                       // and the value there as a position in its band: 0 lower end, 1 upper end
    int band;                             // band of the segment; in a balanced span it may leave 0 ... level_count
    bool inside;                          // inside the volume (or the valid cells)
    bool balanced;                        // the crossings of this span add up, see weigh_span
    bool fresh;                           // no crossing since the entry: the band rests on the face's value alone
    uint normal;                          // packed normal at the front end; 0: none
    uint violations, reordered, saturated;
};

Walk walk;

// Normal at a part of the way between two crossings, so that the light does not jump where a cut passes a crossing; that
// of the other end where the box has none (0). Zero where both have none, or where the two cancel.
vec3 normal_between(uint front, uint back, float part) {
#if SHADING
    vec3 first = unpack_normal(front != 0u ? front : back);
    vec3 last = unpack_normal(back != 0u ? back : front);
    vec3 mixed = (front | back) != 0u ? mix(first, last, part) : vec3(0.0);
    return mixed / max(length(mixed), 1e-6);
#else
    return vec3(0.0);
#endif
}

// Colour lit by a normal, or as it is without one.
vec3 lit(vec3 straight, vec3 normal) {
#if SHADING
    if (normal != vec3(0.0)) return blinn_phong(straight, normal, ray_direction, frame.material);
#endif
    return straight;
}

void composite(vec3 premultiplied, float opacity) {
    walk.radiance += walk.transmittance * premultiplied;
    walk.transmittance *= 1.0 - opacity;
}

Band current_band() { return bands[clamp(walk.band, 0, frame.level_count)]; }

// Composites the segment up to `distance`, where the value is at `position` of the current band, and moves there.
void advance(float distance, float position, uint normal) {
    Band band = current_band();
    float start = max(walk.distance, walk.visible_start);
    float end = min(distance, walk.visible_end);
    if (band.extinction_max > 0.0 && end > start) {
        float span = distance - walk.distance;
        float length = end - start;
        float part = (start - walk.distance) / span;
        vec3 front_normal = normal_between(walk.normal, normal, part);
#if SEGMENT_RULE == 2
        float last_part = (end - walk.distance) / span;
        vec3 back_normal = normal_between(walk.normal, normal, last_part);
        vec4 front = mix(band.low, band.high, mix(walk.position, position, part));
        vec4 back = mix(band.low, band.high, mix(walk.position, position, last_part));
        vec2 weights = segment_weights(front.a * length, back.a * length);
        composite(weights.x * lit(front.rgb, front_normal) + weights.y * lit(back.rgb, back_normal),
                  weights.x + weights.y);
#else
        vec4 front = mix(band.low, band.high, walk.position);
        float depth = front.a * length;
#if SEGMENT_RULE == 1
        if (depth > 1.0) ++walk.saturated;
        float opacity = min(depth, 1.0);
#else
        float opacity = opacity_from_depth(depth);
#endif
        composite(opacity * lit(front.rgb, front_normal), opacity);
#endif
    }
    walk.distance = distance;
    walk.position = position;
    walk.normal = normal;
}

void composite_impulse(int level, uint normal) {
    vec4 impulse = impulses[level];
    if (impulse.a == 0.0 || walk.distance < walk.visible_start || walk.distance > walk.visible_end) return;
    composite(impulse.a * lit(impulse.rgb, normal_between(normal, normal, 0.0)), impulse.a);
}

bool is_rising(Node node) { return (node.surface & RISING_BIT) != 0u; }

bool is_domain(Node node) { return (node.surface & LEVEL_MASK) == DOMAIN_LEVEL; }

int band_before(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 0 : 1); }

int band_after(Node node) { return int(node.surface & LEVEL_MASK) + (is_rising(node) ? 1 : 0); }

// End of the current band that is nearer to a level.
float end_towards(int level) { return level >= walk.band ? 1.0 : 0.0; }

// The point where the ray leaves the box, as a node.
Node leaving_node(float distance, float value) {
    return Node(LIST_END, distance, DOMAIN_LEVEL, floatBitsToUint(value));
}

void enter(float distance, float value) {
    walk.inside = true;
    walk.distance = distance;
    walk.band = band_of(value);
    walk.position = band_position(bands[walk.band].value_low, bands[walk.band].inverse_width, value);
    walk.normal = 0u;
    walk.fresh = true;
}

// Where the next node of a sorted list is: `index` of node `i` - 1 and the number `i`.
uint next_in_list(uint index, uint i, bool in_array) { return in_array ? sorted_indices[i] : nodes[index].next_index; }

// Adds up the crossings from node `i` to the end of the span. If they lead from the band of the entry to that of the
// exit, none was lost: the span is balanced, and every crossing moves the walk by one band, whatever its level. That
// holds too where the meshes of neighbouring levels cut each other inside a cell, so that crossings stand in the wrong
// order. Where the face's value and the surfaces disagree about the band at the box (the face is bilinear, the mesh's
// outline on it a chord; or by rounding), the surfaces decide.
void weigh_span(uint index, uint i, uint length, bool in_array, Node last) {
    int net = 0;
    int first_before = -1;
    int last_after = -1;
    Node node = last;
    for (; i < length; ++i) {
        if (i > 0u) index = next_in_list(index, i, in_array);
        else if (in_array) index = sorted_indices[0];
        node = nodes[index];
        if (is_domain(node)) break;
        if (first_before < 0) first_before = band_before(node);
        last_after = band_after(node);
        net += is_rising(node) ? 1 : -1;
    }
    if (i == length) node = last;
    int leaving = is_domain(node) ? band_of(uintBitsToFloat(node.normal)) : last_after;
    bool by_entry = walk.band + net == leaving;
    bool by_first = first_before + net == leaving || first_before + net == last_after;
    walk.balanced = first_before < 0 || by_entry || by_first || walk.band + net == last_after;
    if (first_before >= 0 && !by_entry && by_first && walk.band != first_before) {
        walk.position = walk.band < first_before ? 0.0 : 1.0;
        walk.band = first_before;
    }
}

// The band from which the walk goes through a node. In a span that is not balanced, levels between the walk's band and
// the node's were lost, or before the first crossing the face's value is wrong.
int band_at(Node node) {
    if (is_domain(node)) return walk.fresh ? band_of(uintBitsToFloat(node.normal)) : walk.band;
    int before = band_before(node);
    if (walk.band == before) return before;
    if (walk.balanced) {
        ++walk.reordered;
        return walk.band;
    }
    ++walk.violations;
    if (walk.fresh) {
        walk.position = walk.band < before ? 0.0 : 1.0;
        walk.band = before;
    }
    return before;
}

// Walks to a node: through levels that the list does not hold, where a linear course meets them, then to the node.
void step_to(Node node) {
    bool domain = is_domain(node);
    bool rising = is_rising(node);
    if (domain && rising) enter(node.distance, uintBitsToFloat(node.normal));
    if (!walk.inside || (domain && rising)) return;       // outside: beside the valid cells by rounding
    int level = domain ? -1 : int(node.surface & LEVEL_MASK);
    int target = band_at(node);
    Band band = current_band();
    float start = walk.distance;
    float end = max(node.distance, start);
    float value_start = mix(band.value_low, band.value_high, walk.position);
    float value_end = domain ? uintBitsToFloat(node.normal) : bands[level].value_high;
    bool arrived;
    do {
        arrived = walk.band == target;
        bool upwards = arrived ? rising : walk.band < target;
        int crossed = arrived ? level : (upwards ? walk.band : walk.band - 1);
        float distance = end;
        float position = end_towards(crossed);
        uint normal = domain ? 0u : node.normal;
        if (!arrived) {
            float part = (bands[crossed].value_high - value_start) / (value_end - value_start);
            distance = max(walk.distance, mix(start, end, value_end != value_start ? clamp(part, 0.0, 1.0) : 0.5));
            normal = walk.normal;
        } else if (domain) {
            band = current_band();
            position = band_position(band.value_low, band.inverse_width, value_end);
        }
        advance(distance, position, normal);
        if (crossed >= 0) {
            composite_impulse(crossed, normal);
            walk.band += upwards ? 1 : -1;
            walk.position = end_towards(crossed);
        }
    } while (!arrived);
    walk.fresh = false;
    if (domain) walk.inside = false;
}

// Steps to every node of a sorted list, then to `last` unless it is no border.
void walk_list(uint head, uint length, bool in_array, Node last) {
    uint count = length + (is_domain(last) ? 1u : 0u);
    uint index = head;
    if (walk.inside) weigh_span(index, 0u, length, in_array, last);
    for (uint i = 0u; i < count; ++i) {
        Node node = last;
        if (i < length) {
            if (i > 0u) index = next_in_list(index, i, in_array);
            else if (in_array) index = sorted_indices[0];
            node = nodes[index];
        }
        step_to(node);
        if (is_domain(node) && is_rising(node)) weigh_span(index, i + 1u, length, in_array, last);
        if (walk.transmittance < frame.min_transmittance) {
            atomicAdd(counters.terminated_rays, 1u);
            return;
        }
    }
}

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
    walk = Walk(vec3(0.0), 1.0, 0.0, 0.0, 0.0, 0.0, 0, false, false, false, 0u, 0u, 0u, 0u);
    cut_ray(origin);

    ivec2 in_tile = pixel - frame.tile_origin;
    uint head = heads[in_tile.y * frame.tile_size.x + in_tile.x];
    uint length = list_length(head);
    vec2 inside = box_of_ray(origin);
    bool through_box = inside.x < inside.y;
    if (through_box || frame.box_faces == 0) {
        bool in_array = length <= uint(SORT_CAPACITY);
        if (in_array) sort_into_array(head);
        else if (length <= frame.sorted_length) head = sort_links(head, length);
        Node last = Node(LIST_END, 0.0, 0u, 0u);
        if (frame.box_faces != 0) {
            enter(inside.x, face_value(origin, inside.x));
            last = leaving_node(inside.y, face_value(origin, inside.y));
        }
        walk_list(head, length, in_array, last);
    }
    if (length > 0u) {
        atomicAdd(counters.walked_count, length);
        atomicMax(counters.max_depth_complexity, length);
    }
    if (walk.violations > 0u) atomicAdd(counters.band_violations, walk.violations);
    if (walk.reordered > 0u) atomicAdd(counters.reordered_fragments, walk.reordered);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return vec4(walk.radiance, 1.0 - walk.transmittance) + walk.transmittance * frame.background;
}
