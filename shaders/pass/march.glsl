// The march of a ray: from macrocell to macrocell, with samples inside those that show something.
// Samples have numbers: that of a distance is the same whatever was left out before it, so skipping changes no picture.
// Source: Amanatides and Woo 1987 (3D-DDA); Knoll et al. 2009, sections 6.1 and 6.2.

const int TURNS_OF_LOOP = 8;              // of the loops inside a stretch, that count as one of `loop_limit`

// Where the march is.
struct March {
    int number;                           // sample at which the next stretch begins
    float entry;                          // distance at which the ray entered `macrocell` [world]
    ivec3 macrocell;
};

// A macrocell, or a block of empty ones around it, and where the ray leaves it.
struct Room {
    ivec3 low;                            // first macrocell
    ivec3 high;                           // one behind the last
    float exit;                           // [world]
    int axis;                             // normal of the face through which it leaves
};

float numbered_distance(int number) {
    float distance = sample_distance(raycast.step, ray.growth, float(number) + ray.shift);
    return clamp(distance, ray.start, ray.end);
}

float number_at(float distance) { return sample_number(raycast.step, ray.growth, distance) - ray.shift; }

March fresh_march() {
    ivec3 macrocell = clamp(ivec3(ray_at(ray.seen.x)) / raycast.macrocells.w, ivec3(0), raycast.macrocells.xyz - 1);
    return March(int(floor(number_at(ray.seen.x))), ray.seen.x, macrocell);
}

March resumed_march(RayState state) {
    ray.radiance = state.light.rgb;
    ray.transmittance = state.light.a;
    ray.samples = state.samples;
    return March(state.sample_index, state.entry, ivec3(state.macrocell_xy & 0xFFFFu, state.macrocell_xy >> 16, state.macrocell_z));
}

RayState state_of(March march) {
    uint macrocell_xy = uint(march.macrocell.x) | uint(march.macrocell.y) << 16;
    return RayState(vec4(ray.radiance, ray.transmittance), march.number, march.entry, macrocell_xy, uint(march.macrocell.z), ray.samples);
}

// The macrocell, or, `leap` > 0, the block of those less than `leap` away from it.
Room room_around(March march, int leap) {
    int reach = max(leap - 1, 0);
    Room room;
    room.low = max(march.macrocell - reach, ivec3(0));
    room.high = min(march.macrocell + reach + 1, raycast.macrocells.xyz);
    bvec3 ascends = greaterThan(ray.index_direction, vec3(0.0));
    vec3 bounds = float(raycast.macrocells.w) * mix(vec3(room.low), vec3(room.high), ascends);
    vec3 exits = mix(ray.start + (bounds - ray.index_start) / ray.index_direction, vec3(FAR), equal(ray.index_direction, vec3(0.0)));
    room.axis = exits.x <= exits.y && exits.x <= exits.z ? 0 : exits.y <= exits.z ? 1 : 2;
    room.exit = max(min(exits.x, min(exits.y, exits.z)), march.entry);
    return room;
}

// Moves on to the macrocell behind the room; false if there is none.
bool leave(Room room, inout March march) {
    march.entry = room.exit;
    vec3 index = ray.index_start + (room.exit - ray.start) * ray.index_direction;
    ivec3 beside = clamp(ivec3(floor(index / float(raycast.macrocells.w))), room.low, room.high - 1);
    ivec3 behind = mix(room.low - 1, room.high, greaterThan(ray.index_direction, vec3(0.0)));
    ivec3 next = mix(beside, behind, equal(ivec3(0, 1, 2), ivec3(room.axis)));
    march.macrocell = next;
    return room.exit < ray.seen.y && all(greaterThanEqual(next, ivec3(0))) && all(lessThan(next, raycast.macrocells.xyz));
}

ivec3 macrocell_at(vec3 index) {
    return min(ivec3(index * (1.0 / float(raycast.macrocells.w))), raycast.macrocells.xyz - 1);
}

// Number of the sample after one. Steps of `multiplier` samples stay inside the macrocell of both their ends; a step into
// it and one out of it are of a single sample.
int next_number(March march, uint multiplier) {
#if ADAPTIVE
    ivec3 here = macrocell_at(ray_at(numbered_distance(march.number)));
    Room room = room_around(march, 0);
    int inside = int(floor(number_at(min(room.exit, ray.end))));
    if (here == march.macrocell && march.number < inside) return min(march.number + int(multiplier), inside);
#endif
    return march.number + 1;
}

// Composites stretches until a sample lies in an empty macrocell, or the ray ends: software renderers execute what is
// inside a loop, taken or not, so there is nothing in this one but a sample, its stretch and a look at its macrocell.
// `texel` is that of the macrocells at `march.macrocell`.
void run(int last, inout March march, inout uvec4 texel, inout uint visited, inout int loops) {
    float start = numbered_distance(march.number);
    if (march.number != ray.sampled) {
        ray.value = field(ray_at(start));
        ++ray.samples;
    }
    meet(ray.value);
    bool on = true;
    while (on) {
        march.number = next_number(march, texel.g);
        float end = numbered_distance(march.number);
        vec3 index = ray_at(end);
        float back = field(index);
        ++ray.samples;
        meet(back);
        if (end > start && max(ray.value, back) < MASKED_VALUE) composite_stretch(Stretch(start, end, ray.value, back));
        loops -= 1 + spent_loops / TURNS_OF_LOOP;
        spent_loops = 0;
        start = end;
        ray.value = back;
        ivec3 next = macrocell_at(index);
        texel = texelFetch(macrocells, next, 0);
        if (texel.r == 0u && next != march.macrocell) ++visited;
        march.macrocell = next;
        on = texel.r == 0u && march.number < last && ray.transmittance >= frame.min_transmittance && loops > 0;
    }
    ray.sampled = march.number;
    march.entry = start;
}

// True if the ray is at its end; else `march` is where it goes on.
bool march_on(inout March march) {
    int loops = raycast.loop_limit;
    uint visited = 0u;
    uint skipped = 0u;
    int last = int(ceil(number_at(ray.seen.y)));
    bool ended = march.number >= last;
    uvec4 texel = texelFetch(macrocells, march.macrocell, 0);
    while (!ended && loops > 0) {
        while (texel.r > 0u && !ended && loops > 0) {
            --loops;
            ++skipped;
            ended = !leave(room_around(march, int(texel.r)), march);
            if (!ended) texel = texelFetch(macrocells, march.macrocell, 0);
        }
        march.number = max(march.number, int(floor(number_at(march.entry))));
        ended = ended || march.number >= last;
        if (ended || texel.r > 0u) break;
        ++visited;
        run(last, march, texel, visited, loops);
        ended = march.number >= last || ray.transmittance < frame.min_transmittance;
    }
    if (visited > 0u) atomicAdd(counters.macrocells, visited);
    if (skipped > 0u) atomicAdd(counters.skipped, skipped);
    if (ended && ray.transmittance < frame.min_transmittance) atomicAdd(counters.terminated_rays, 1u);
    return ended;
}
