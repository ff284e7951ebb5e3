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

// The empty macrocells that a ray leaps over, or a single one, and where the ray leaves them.
struct Room {
    vec3 near;                            // macrocell in which the ray is
    vec3 far;                             // last of the room, along every axis in the direction of the ray
    vec3 exits;                           // distances at which it leaves the room through the faces across each axis [world]
    float exit;                           // the least of them, but not before the ray's entry into the macrocell [world]
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

// The macrocells less than `leap` behind one, along every axis in the direction of the ray.
Room room_behind(March march, float leap) {
    Room room;
    room.near = vec3(march.macrocell);
    room.far = room.near + (leap - 1.0) * ray.towards;
    vec3 faces = float(raycast.macrocells.w) * (room.far + 0.5 + 0.5 * ray.towards);
    room.exits = mix(ray.start + (faces - ray.index_start) * ray.inverse, vec3(FAR), equal(ray.inverse, vec3(0.0)));
    room.exit = max(min(room.exits.x, min(room.exits.y, room.exits.z)), march.entry);
    return room;
}

// Moves on to the macrocell behind the room; false if there is none.
bool leave(Room room, inout March march) {
    march.entry = room.exit;
    vec3 index = ray.index_start + (room.exit - ray.start) * ray.index_direction;
    vec3 beside = clamp(floor(index / float(raycast.macrocells.w)), min(room.near, room.far), max(room.near, room.far));
    vec3 next = mix(beside, room.far + ray.towards, lessThanEqual(room.exits, vec3(room.exit)));
    march.macrocell = ivec3(next);
    return room.exit < ray.seen.y && all(greaterThanEqual(march.macrocell, ivec3(0))) && all(lessThan(march.macrocell, raycast.macrocells.xyz));
}

uint macrocell_texel(ivec3 macrocell) {
    return textureLod(macrocells, (vec3(macrocell) + 0.5) / vec3(raycast.macrocells.xyz), 0.0).r;
}

// Of a texel of the macrocells: whether something is seen there; of others, how far the ray may leap; steps to be taken as one.
bool occupied(uint texel) { return (texel & LEAP_MASK) == 0u; }
float leap_of(uint texel) { return float(bitfieldExtract(texel, ray.octant * LEAP_BITS, LEAP_BITS)); }
int multiplier_of(uint texel) { return int(texel >> LEAP_BITS); }

ivec3 macrocell_at(vec3 index) {
    return min(ivec3(index * (1.0 / float(raycast.macrocells.w))), raycast.macrocells.xyz - 1);
}

// Number of the sample after one. Steps of several samples stay inside the macrocell of both their ends; a step into
// it and one out of it are of a single sample.
int next_number(March march, uint texel) {
#if ADAPTIVE
    ivec3 here = macrocell_at(ray_at(numbered_distance(march.number)));
    int inside = int(floor(number_at(min(room_behind(march, 1.0).exit, ray.end))));
    if (here == march.macrocell && march.number < inside) return min(march.number + multiplier_of(texel), inside);
#endif
    return march.number + 1;
}

// Composites stretches until a sample lies in an empty macrocell, or the ray ends: software renderers execute what is
// inside a loop, taken or not, so there is nothing in this one but a sample, its stretch and a look at its macrocell, and it
// ends with its condition: one that begins with it is executed once more.
// `texel` is that of the macrocells at `march.macrocell`.
void run(int last, inout March march, inout uint texel, inout uint visited, inout int loops) {
    float start = numbered_distance(march.number);
    if (march.number != ray.sampled) {
        ray.value = field(ray_at(start));
        ++ray.samples;
    }
    meet(ray.value);
    int turns = 0;
    bool on;
    spent_loops = 0;
    do {
        march.number = next_number(march, texel);
        float end = numbered_distance(march.number);
        vec3 index = ray_at(end);
        float back = field(index);
        meet(back);
        if (end > start && max(ray.value, back) < MASKED_VALUE) composite_stretch(Stretch(start, end, ray.value, back));
        start = end;
        ray.value = back;
        ivec3 next = macrocell_at(index);
        texel = macrocell_texel(next);
        if (occupied(texel) && next != march.macrocell) ++visited;
        march.macrocell = next;
        ++turns;
        on = occupied(texel) && march.number < last && ray.transmittance >= frame.min_transmittance && turns + spent_loops / TURNS_OF_LOOP < loops;
    } while (on);
    ray.samples += uint(turns);
    loops -= turns + spent_loops / TURNS_OF_LOOP;
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
    uint texel = macrocell_texel(march.macrocell);
    if (!ended) do {
        if (!occupied(texel)) {
            bool on;
            do {
                --loops;
                ++skipped;
                ended = !leave(room_behind(march, leap_of(texel)), march);
                if (!ended) texel = macrocell_texel(march.macrocell);
                on = !ended && !occupied(texel) && loops > 0;
            } while (on);
        }
        march.number = max(march.number, int(floor(number_at(march.entry))));
        ended = ended || march.number >= last;
        if (!ended && occupied(texel)) {
            ++visited;
            run(last, march, texel, visited, loops);
            ended = march.number >= last || ray.transmittance < frame.min_transmittance;
        }
    } while (!ended && loops > 0);
    if (visited > 0u) atomicAdd(counters.macrocells, visited);
    if (skipped > 0u) atomicAdd(counters.skipped, skipped);
    if (ended && ray.transmittance < frame.min_transmittance) atomicAdd(counters.terminated_rays, 1u);
    return ended;
}
