// The march of a ray: from macrocell to macrocell, with samples inside those that show something.
// Samples have numbers: that of a distance is the same whatever was left out before it, so skipping changes no picture.
// Source: Amanatides and Woo 1987 (3D-DDA); Knoll et al. 2009, sections 6.1 and 6.2.

const int TURNS_OF_LOOP = 8;              // of the loops inside a stretch, that count as one of `loop_limit`

// Where the march is.
struct March {
    int number;                           // sample at which the next stretch begins
    float entry;                          // distance at which the ray entered `macrocell` [world]
    vec3 macrocell;                       // in the ray's own octant, in which it ascends along every axis; maybe beyond the grid
};

float numbered_distance(int number) {
    float distance = sample_distance(raycast.step, ray.growth, float(number) + ray.shift);
    return clamp(distance, ray.start, ray.end);
}

float number_at(float distance) { return sample_number(raycast.step, ray.growth, distance) - ray.shift; }

vec3 macrocell_at(float distance) { return floor(ray.macro_start + (distance - ray.start) * ray.macro_direction); }

March fresh_march() { return March(int(floor(number_at(ray.seen.x))), ray.seen.x, macrocell_at(ray.seen.x)); }

March resumed_march(RayState state) {
    ray.radiance = state.light.rgb;
    ray.transmittance = state.light.a;
    ray.samples = state.samples;
    return March(state.sample_index, state.entry, macrocell_at(state.entry));
}

RayState state_of(March march) {
    return RayState(vec4(ray.radiance, ray.transmittance), march.number, march.entry, ray.samples, raycast.tile_number);
}

// Texel of a macrocell, or of that of the grid next to it.
uint macrocell_texel(vec3 macrocell) { return textureLod(macrocells, (macrocell + 0.5) * ray.macro_texel, 0.0).r; }

// Of a texel of the macrocells: whether something is seen there; of others, how far the ray may leap; steps to be taken as one.
bool occupied(uint texel) { return (texel & LEAP_MASK) == 0u; }
float leap_of(uint texel) { return float(bitfieldExtract(texel, ray.leap_bit, LEAP_BITS)); }
int multiplier_of(uint texel) { return int(texel >> LEAP_BITS); }

// Distances at which the ray leaves the `leap` macrocells from its own one on, by the axis across the face.
vec3 exits_of(March march, float leap) {
    return ray.macro_base + (march.macrocell + leap - ray.macro_start) * ray.macro_inverse;
}

// Moves on to the macrocell behind a leap; beyond the grid all is empty.
void leap_on(float leap, inout March march) {
    vec3 exits = exits_of(march, leap);
    march.entry = max(min(exits.x, min(exits.y, exits.z)), march.entry);
    vec3 beside = clamp(macrocell_at(march.entry), march.macrocell, march.macrocell + (leap - 1.0));
    march.macrocell = mix(beside, march.macrocell + leap, lessThanEqual(exits, vec3(march.entry)));
}

// Number of the sample after one. Steps of several samples stay inside the macrocell of both their ends; a step into
// it and one out of it are of a single sample.
int next_number(March march, uint texel) {
#if ADAPTIVE
    bool here = all(equal(macrocell_at(numbered_distance(march.number)), march.macrocell));
    vec3 exits = exits_of(march, 1.0);
    int inside = int(floor(number_at(min(min(exits.x, ray.end), min(exits.y, exits.z)))));
    if (here && march.number < inside) return min(march.number + multiplier_of(texel), inside);
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
        float back = field(ray_at(end));
        meet(back);
        if (end > start && max(ray.value, back) < MASKED_VALUE) composite_stretch(Stretch(start, end, ray.value, back));
        start = end;
        ray.value = back;
        vec3 next = macrocell_at(end);
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
                leap_on(leap_of(texel), march);
                texel = macrocell_texel(march.macrocell);
                ended = march.entry >= ray.seen.y;
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
