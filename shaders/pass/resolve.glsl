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

const float TIE_DISTANCE = 4e-6;          // of the box radius: crossings this close may have been rounded out of order

struct Walk {
    vec3 radiance;                        // premultiplied, in front of the current position
    float transmittance;
    float visible_start, visible_end;     // the part of the ray that is not cut away [world]
    float distance;                       // front end of the current segment [world]
    float position;                       // and the value there as a position in its band: 0 lower end, 1 upper end
    int band;                             // band of the segment; -1 outside the volume
    bool fresh;                           // no crossing since the entry: the band rests on the face's value alone
    uint normal;                          // packed normal at the front end; 0: none
    uint violations, saturated;
};

Walk walk;

// Colour lit by the normal of either end of a segment (`fallback` where the box cuts it), or as it is without one.
vec3 lit(vec3 straight, uint normal, uint fallback) {
#if SHADING
    uint chosen = normal != 0u ? normal : fallback;
    if (chosen != 0u) return blinn_phong(straight, unpack_normal(chosen), ray_direction, frame.material);
#endif
    return straight;
}

void composite(vec3 premultiplied, float opacity) {
    walk.radiance += walk.transmittance * premultiplied;
    walk.transmittance *= 1.0 - opacity;
}

// Composites the segment up to `distance`, where the value is at `position` of the current band, and moves there.
void advance(float distance, float position, uint normal) {
    Band band = bands[walk.band];
    float start = max(walk.distance, walk.visible_start);
    float end = min(distance, walk.visible_end);
    if (band.extinction_max > 0.0 && end > start) {
        float span = distance - walk.distance;
        float length = end - start;
#if SEGMENT_RULE == 2
        vec4 front = mix(band.low, band.high, mix(walk.position, position, (start - walk.distance) / span));
        vec4 back = mix(band.low, band.high, mix(walk.position, position, (end - walk.distance) / span));
        vec2 weights = segment_weights(front.a * length, back.a * length);
        composite(weights.x * lit(front.rgb, walk.normal, normal) + weights.y * lit(back.rgb, normal, walk.normal),
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
        composite(opacity * lit(front.rgb, walk.normal, normal), opacity);
#endif
    }
    walk.distance = distance;
    walk.position = position;
    walk.normal = normal;
}

void composite_impulse(int level, uint normal) {
    vec4 impulse = impulses[level];
    if (impulse.a == 0.0 || walk.distance < walk.visible_start || walk.distance > walk.visible_end) return;
    composite(impulse.a * lit(impulse.rgb, normal, normal), impulse.a);
}

int band_before(Node node) { return int(node.surface & LEVEL_MASK) + ((node.surface & RISING_BIT) != 0u ? 0 : 1); }

bool is_domain(Node node) { return (node.surface & LEVEL_MASK) == DOMAIN_LEVEL; }

// The point of the box's border (or the valid cells') at `distance`, as a node.
Node border_node(float distance, float value, bool entering) {
    return Node(LIST_END, distance, DOMAIN_LEVEL | (entering ? RISING_BIT : 0u), floatBitsToUint(value));
}

void enter(float distance, float value) {
    walk.distance = distance;
    walk.band = band_of(value);
    walk.position = band_position(bands[walk.band].value_low, bands[walk.band].inverse_width, value);
    walk.normal = 0u;
    walk.fresh = true;
}

// The band from which the walk reaches a node. Where a surface does not continue the walk, the levels in between were
// lost; but right behind the entry the surface decides: the face is bilinear, the mesh's outline on it a chord, and in
// the sliver between the two (or by rounding) they differ. For the same reason a ray that crossed surfaces leaves from
// the band they say, and only one that crossed none follows the two face values.
int band_at(Node node) {
    if (is_domain(node)) return walk.fresh ? band_of(uintBitsToFloat(node.normal)) : walk.band;
    int before = band_before(node);
    if (walk.band == before) return before;
    if (!walk.fresh) {
        ++walk.violations;
        return before;
    }
    walk.position = walk.band < before ? 0.0 : 1.0;
    walk.band = before;
    return before;
}

// Walks to a node: through levels that the list does not hold, where a linear course meets them, then to the node.
void step_to(Node node) {
    bool domain = is_domain(node);
    bool rising = (node.surface & RISING_BIT) != 0u;
    if (domain && rising) enter(node.distance, uintBitsToFloat(node.normal));
    if (walk.band < 0 || (domain && rising)) return;      // outside: beside the valid cells by rounding
    int level = domain ? -1 : int(node.surface & LEVEL_MASK);
    int target = band_at(node);
    float start = walk.distance;
    float end = max(node.distance, start);
    float value_start = mix(bands[walk.band].value_low, bands[walk.band].value_high, walk.position);
    float value_end = domain ? uintBitsToFloat(node.normal) : bands[level].value_high;
    bool arrived;
    do {
        arrived = walk.band == target;
        bool upwards = arrived ? rising : walk.band < target;
        int crossed = arrived ? level : (upwards ? walk.band : walk.band - 1);
        float distance = end;
        float position = upwards ? 1.0 : 0.0;
        uint normal = domain ? 0u : node.normal;
        if (!arrived) {
            float part = (bands[crossed].value_high - value_start) / (value_end - value_start);
            distance = max(walk.distance, mix(start, end, value_end != value_start ? clamp(part, 0.0, 1.0) : 0.5));
            normal = walk.normal;
        } else if (domain) {
            position = band_position(bands[target].value_low, bands[target].inverse_width, value_end);
        }
        advance(distance, position, normal);
        if (crossed >= 0) {
            composite_impulse(crossed, normal);
            walk.band = upwards ? crossed + 1 : crossed;
            walk.position = upwards ? 0.0 : 1.0;
        }
    } while (!arrived);
    walk.fresh = false;
    if (domain) walk.band = -1;
}

// True if `second` may come first: both crossings lie within rounding, and only that order continues the walk.
bool swapped(Node first, Node second) {
    if (walk.band < 0 || is_domain(first) || is_domain(second)) return false;
    return second.distance - first.distance <= TIE_DISTANCE * frame.box_radius
        && band_before(first) != walk.band && band_before(second) == walk.band;
}

// Steps to every node of a sorted list, then to `last` unless it is no border.
void walk_list(uint head, uint length, bool in_array, Node last) {
    uint count = length + (is_domain(last) ? 1u : 0u);
    uint index = head;
    Node current = last;
    if (length > 0u) {
        if (in_array) index = sorted_indices[0];
        current = nodes[index];
    }
    for (uint i = 1u; i <= count; ++i) {
        Node next = last;
        if (i < length) {
            index = in_array ? sorted_indices[i] : nodes[index].next_index;
            next = nodes[index];
        }
        bool swap = i < length && swapped(current, next);
        step_to(swap ? next : current);
        if (!swap) current = next;
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
    walk = Walk(vec3(0.0), 1.0, 0.0, 0.0, 0.0, 0.0, -1, false, 0u, 0u, 0u);
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
            last = border_node(inside.y, face_value(origin, inside.y), false);
        }
        walk_list(head, length, in_array, last);
    }
    if (length > 0u) {
        atomicAdd(counters.walked_count, length);
        atomicMax(counters.max_depth_complexity, length);
    }
    if (walk.violations > 0u) atomicAdd(counters.band_violations, walk.violations);
    if (walk.saturated > 0u) atomicAdd(counters.saturated_segments, walk.saturated);
    return vec4(walk.radiance, 1.0 - walk.transmittance) + walk.transmittance * frame.background;
}
