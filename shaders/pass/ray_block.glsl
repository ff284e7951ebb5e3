// The rays of a block of pixels as one: a ray through the block's middle with a reach, along each axis of the grid, within which
// all of them lie. It leaps over the macrocells that are empty for all of them; what is left of the ray is the block's span.
// Distances are those along each ray, of which all are unit vectors: rays of a block lie within the reach at equal distances.

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std140, binding = BINDING_RAYCAST) uniform RaycastBlock { Raycast raycast; };
layout(binding = UNIT_MACROCELLS) uniform usampler3D macrocells;

const float NEVER = 1e30;
const vec2 NOTHING_SEEN = vec2(NEVER, -NEVER);
const int MOST_LEAPS = 512;               // then the span is left as long as it is
const float LEAST_WAY = 0.01;             // of a leap, and what float32 may be off by [sample index]
const float ROUNDING = 2e-6;              // of a distance: some roundings of float32

// The middle ray, and what lies within its reach, in sample indices.
struct BlockRay {
    vec3 start;                           // at distance 0
    vec3 direction;                       // per world unit
    vec3 reach;                           // at distance 0
    vec3 widening;                        // of the reach per world unit
};

vec3 per_axis(vec3 local) {
    return vec3(dot(raycast.index_row_x.xyz, local), dot(raycast.index_row_y.xyz, local), dot(raycast.index_row_z.xyz, local));
}

vec3 row_lengths() {
    return vec3(length(raycast.index_row_x.xyz), length(raycast.index_row_y.xyz), length(raycast.index_row_z.xyz));
}

// The middle ray of a block; `around` are the distances within which any of its rays can be in the box.
//   Perspective: directions before they are made unit vectors have lengths >= 1, so that unit vectors differ by no more than
//   these: at the distance t by t times half the block's diagonal on the plane at distance 1.
BlockRay block_ray(ivec2 block, out vec2 around) {
    vec2 plane = 2.0 * (float(RAY_BLOCK) * (vec2(block) + 0.5)) / vec2(frame.image_size) - 1.0;
    vec3 offset = plane.x * frame.span_right + plane.y * frame.span_up;
    vec3 half_right = float(RAY_BLOCK) / float(frame.image_size.x) * frame.span_right;
    vec3 half_up = float(RAY_BLOCK) / float(frame.image_size.y) * frame.span_up;
    vec3 direction = normalize(frame.forward + frame.perspective * offset);
    vec3 origin = frame.eye + (1.0 - frame.perspective) * offset;
    float middle = frame.perspective * length(origin) - (1.0 - frame.perspective) * dot(origin, direction);
    float radius = 1.001 * frame.box_radius + ROUNDING * length(origin);
    around = vec2(max(middle - radius, 0.0), middle + radius);
    BlockRay ray;
    ray.start = per_axis(origin) + vec3(raycast.index_row_x.w, raycast.index_row_y.w, raycast.index_row_z.w);
    ray.direction = per_axis(direction);
    float parallel = 1.0 - frame.perspective;
    ray.reach = parallel * (abs(per_axis(half_right)) + abs(per_axis(half_up))) + LEAST_WAY + ROUNDING * length(origin) * row_lengths();
    ray.widening = (frame.perspective * (length(half_right) + length(half_up)) + ROUNDING) * row_lengths();
    return ray;
}

// The leap that may be taken in every octant, 0 where something is seen.
float leap_all_around(uint texel) {
    uint least = texel & LEAP_MASK;
    for (int octant = 1; octant < 8; ++octant) least = min(least, bitfieldExtract(texel, octant * LEAP_BITS, LEAP_BITS));
    return float(least);
}

// How far from `distance` on, along the ray (sign 1) or against it (-1), every ray of the block is inside macrocells that are
// known to be empty; below 0 if they are not [world]. Beyond the grid all is empty: from a place outside, macrocells are at
// least as far away as from the nearest one of the grid, and as that is from the place.
float leap(BlockRay ray, float distance, float sign) {
    vec3 index = ray.start + distance * ray.direction;
    vec3 place = floor(index / float(raycast.macrocells.w));
    vec3 nearest = clamp(place, vec3(0.0), vec3(raycast.macrocells.xyz - 1));
    vec3 outside = abs(place - nearest);
    float empty = max(leap_all_around(texelFetch(macrocells, ivec3(nearest), 0).r), max(outside.x, max(outside.y, outside.z)));
    vec3 reach = ray.reach + distance * ray.widening;
    vec3 widening = max(sign, 0.0) * ray.widening;
    vec3 to_low = index - reach - float(raycast.macrocells.w) * (place - (empty - 1.0));
    vec3 to_high = float(raycast.macrocells.w) * (place + empty) - index - reach;
    vec3 speed = sign * ray.direction;
    vec3 low_ways = mix(vec3(NEVER), to_low / max(widening - speed, 1e-30), greaterThan(widening - speed, vec3(0.0)));
    vec3 high_ways = mix(vec3(NEVER), to_high / max(widening + speed, 1e-30), greaterThan(widening + speed, vec3(0.0)));
    vec3 ways = min(low_ways, high_ways);
    bool inside = empty > 0.0 && all(greaterThan(min(to_low, to_high), vec3(0.0)));
    return inside ? min(ways.x, min(ways.y, ways.z)) : -1.0;
}

// Distances between which a ray of the block may see something; x > y if none does.
vec2 block_span(ivec2 block) {
    vec2 span;
    BlockRay ray = block_ray(block, span);
    float least = LEAST_WAY / max(length(ray.direction), 1e-30);
    float way = 0.0;
    for (int leaps = 0; leaps < MOST_LEAPS && way >= 0.0 && span.x < span.y; ++leaps) {
        way = leap(ray, span.x, 1.0);
        if (way < least) way = -1.0;
        span.x += max(way, 0.0);
    }
    if (span.x >= span.y) return NOTHING_SEEN;
    way = 0.0;
    for (int leaps = 0; leaps < MOST_LEAPS && way >= 0.0 && span.x < span.y; ++leaps) {
        way = leap(ray, span.y, -1.0);
        if (way < least) way = -1.0;
        span.y -= max(way, 0.0);
    }
    return span;
}
