// Every crossing of a stretch: cell by cell of the grid, in which the field along the ray is a cubic (with a smooth
// reconstruction: is taken for the cubic through four of its values). Cells that cannot leave the band that the ray is in,
// and in which nothing is seen, cost no more than the samples at their corners.
// Source: Ament et al. 2010, section 5; extinction inside a band as in lib/segment.glsl.

#if METHOD == 2 && CROSSINGS == 1
#include "lib/segment.glsl"
#include "lib/cell_cubic.glsl"

const float NARROW = 1e-3;                // of a cell's part: the way across a narrow band follows from the slope

// The part of a ray in one cell.
struct CellPart {
    float start;                          // distance [world]
    float end;
    vec4 cubic;                           // of the values, see lib/cell_cubic.glsl
};

// Where the walk through the bands is.
struct BandWalk {
    int band;
    vec4 range;                           // of the band, see pass/transfer.glsl
    bool found;                           // peaks were composited
};

BandWalk walk;

void enter_band(int band) {
    walk.band = band;
    walk.range = band_texel(band, TEXEL_RANGE);
}

float least(vec4 b) { return min(min(b.x, b.y), min(b.z, b.w)); }

float largest(vec4 b) { return max(max(b.x, b.y), max(b.z, b.w)); }

// Whether values between these two are in the walk's band; beyond the last level everything is.
bool in_band(float low, float high) {
    return (low >= walk.range.x || walk.band == 0) && (high < walk.range.y || walk.band == raycast.band_count - 1);
}

// Whether nothing is to be seen where values stay between these two.
bool unseen(float low, float high) { return (PEAK_WEIGHT == 0 || walk.range.z == 0.0) && in_band(low, high); }

// The extinction of the walk's band along the part [s0, s1] of a cell, on which the values run from `front` to `back`.
void composite_curve(CellPart part, float s0, float s1, float front, float back) {
    vec4 optics_low = band_texel(walk.band, TEXEL_OPTICS_LOW);
    vec4 optics_high = band_texel(walk.band, TEXEL_OPTICS_HIGH);
    float width = s1 - s0;
    float way = width;
    vec2 slopes = vec2(cubic_slope(part.cubic, s0), cubic_slope(part.cubic, s1)) * (width * walk.range.w);
    vec2 positions = vec2(band_position(walk.range.x, walk.range.w, front), band_position(walk.range.x, walk.range.w, back));
    if (width < NARROW) {
        float steepness = abs(cubic_slope(part.cubic, 0.5 * (s0 + s1)));
        if (abs(back - front) < NARROW * steepness) way = abs(back - front) / steepness;
        slopes = vec2(positions.y - positions.x);
    }
    way *= part.end - part.start;
    if (!(way > 0.0)) return;
    vec4 moments = cubic_moments(vec2(optics_low.a, optics_high.a) * way, positions.x, positions.y, slopes, vec2(0.0, 1.0));
    vec3 emission = optics_low.rgb * (moments.x - moments.y) + optics_high.rgb * moments.y;
#if SHADING
    vec2 light = light_at(mix(part.start, part.end, s0));
    vec2 change = light_at(mix(part.start, part.end, s1)) - light;
    emission = emission * light.x + light.y * moments.x + change.y * moments.z
             + change.x * (optics_low.rgb * (moments.z - moments.w) + optics_high.rgb * moments.w);
#endif
    composite(emission, moments.x);
}

#if PEAK_WEIGHT == 1 && PEAK_MODE == 2
// Whether there is a peak between two bands, one of which is the walk's.
bool has_peak(int last) {
    int high = max(walk.band, last);
    for (int level = min(walk.band, last); level < high; ++level) {
        if (band_texel(level, TEXEL_SHEET).r > 0.0 || band_texel(level, TEXEL_IMPULSE).a > 0.0) return true;
    }
    return false;
}
#endif

// A monotone piece [s0, s1] of a cell's part: from the walk's band to that of its last value.
void composite_piece(CellPart part, float s0, float s1, float front, float back) {
    int last = in_band(back, back) ? walk.band : band_of(back);
    if (last == walk.band && (PEAK_WEIGHT == 0 || walk.range.z == 0.0)) return;
    bool rising = last > walk.band || (last == walk.band && back > front);
#if PEAK_WEIGHT == 1 && PEAK_MODE == 2
    bool shown = has_peak(last);
#else
    bool shown = true;
#endif
    float s = s0;
    while (true) {
        spent_loops += 5;                 // this one's, those of cubic_root and of cubic_moments
        bool ends = walk.band == last;
        int number = rising ? walk.band : walk.band - 1;
        float level = rising ? walk.range.y : walk.range.x;
        float next = s1;
        vec4 sheet = vec4(0.0);
        vec4 impulse = vec4(0.0);
        if (!ends) {
            if (PEAK_WEIGHT == 0) sheet = band_texel(number, TEXEL_SHEET);
            impulse = band_texel(number, TEXEL_IMPULSE);
            bool needed = PEAK_WEIGHT == 1 || sheet.a > 0.0 || impulse.a > 0.0;
            next = needed ? cubic_root(part.cubic, level, s, s1, rising) : s;
        }
#if PEAK_WEIGHT == 1
        if (shown && walk.range.z > 0.0) composite_curve(part, s, next, front, ends ? back : level);
#endif
        if (ends) break;
        walk.found = walk.found || sheet.a > 0.0 || impulse.a > 0.0;
        composite_surface(mix(part.start, part.end, next), sheet);
        composite_surface(mix(part.start, part.end, next), impulse);
        enter_band(rising ? walk.band + 1 : walk.band - 1);
        s = next;
        front = level;
    }
}

void composite_part(CellPart part) {
    if (unseen(least(part.cubic), largest(part.cubic))) return;
    vec2 extrema = cubic_extrema(part.cubic);
    float s = 0.0;
    float front = part.cubic.x;
    for (int piece = 0; piece < 3 && s < 1.0; ++piece) {
        ++spent_loops;
        float next = piece == 0 ? extrema.x : piece == 1 ? extrema.y : 1.0;
        float back = next < 1.0 ? cubic_value(part.cubic, next) : part.cubic.w;
        composite_piece(part, s, next, front, back);
        s = next;
        front = back;
    }
}

// The field along the part of a ray in one cell; on entry the first coefficient is the value at its start, and the last one,
// where the stretch `ends` there, at its end. False where it touches a sample that is not there (`masked`) and where nothing is
// to be seen in the whole cell: its corners tell.
bool cubic_in(ivec3 cell, bool ends, inout CellPart part, out bool masked) {
    vec2 known = part.cubic.xw;
#if RECONSTRUCTION == 0
    ++ray.roots;
    vec4 near = quad_at(cell);
    vec4 far = quad_at(cell + ivec3(0, 0, 1));
    float lowest = min(least(near), least(far));
    float highest = max(largest(near), largest(far));
    masked = highest > MASKED_VALUE;
    if (masked || unseen(ends ? min(lowest, known.y) : lowest, ends ? max(highest, known.y) : highest)) return false;
    vec3 low = clamp(ray_at(part.start) - vec3(cell), 0.0, 1.0);
    vec3 high = clamp(ray_at(part.end) - vec3(cell), 0.0, 1.0);
    part.cubic = cubic_between(near, far, low, high);
#else
    spent_loops += 3;                     // no loops, but as many values of the field
    float third = (part.end - part.start) / 3.0;
    float back = ends ? known.y : ray_value(part.end);
    part.cubic = vec4(known.x, ray_value(part.start + third), ray_value(part.end - third), back);
    masked = largest(part.cubic) > MASKED_VALUE;
    if (masked) return false;
    part.cubic = cubic_through(part.cubic);
#endif
    if (ends) part.cubic.w = known.y;
    return true;
}

// Everything in the stretch; whether there was a peak. The bands of the values at its ends, which it shares with its
// neighbours, are those that it begins and ends in, so that no crossing is lost or doubled between two stretches.
bool composite_cells(Stretch stretch) {
    walk.found = false;
    enter_band(band_of(stretch.front));
    ivec3 forward = ivec3(greaterThanEqual(ray.index_direction, vec3(0.0)));
    bvec3 across = equal(ray.index_direction, vec3(0.0));
    vec3 inverse = 1.0 / mix(ray.index_direction, vec3(1.0), across);
    ivec3 cell = cell_at(ray_at(stretch.start));
    CellPart part = CellPart(stretch.start, stretch.start, vec4(stretch.front));
    bool known = true;                    // the walk's band is that of the value at the part's start
    bool ends = false;
    while (!ends) {
        ++spent_loops;
        vec3 exits = mix(ray.start + (vec3(cell + forward) - ray.index_start) * inverse, vec3(1e30), across);
        part.end = max(min(min(exits.x, exits.y), exits.z), part.start);
        ivec3 next = cell + ivec3(lessThanEqual(exits, vec3(part.end))) * (2 * forward - 1);
        ends = part.end >= stretch.end || clamp(next, ivec3(0), raycast.samples.xyz - 2) != next;
        if (ends) part.end = stretch.end;
        if (part.end > part.start) {
            part.cubic = vec4(part.cubic.w, 0.0, 0.0, stretch.back);
            bool masked;
            if (cubic_in(cell, ends, part, masked)) {
                if (!known) enter_band(band_of(part.cubic.x));
                if (part.start == stretch.start) part.cubic.x = stretch.front;
                composite_part(part);
            }
            known = !masked;
        }
        part.start = part.end;
        cell = next;
    }
    return walk.found;
}
#endif
