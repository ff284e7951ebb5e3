// Ray caster: marches a ray through the macrocells and composites the stretches between its samples, front to back.
// Expects the constants of the entry file.
// Source: Knoll et al. 2009, sections 5 and 6, Algorithm 1.

layout(std140, binding = BINDING_FRAME) uniform FrameBlock { Frame frame; };
layout(std140, binding = BINDING_RAYCAST) uniform RaycastBlock { Raycast raycast; };
layout(std430, binding = BINDING_RAY_COUNTERS) buffer RayCounterBlock { RayCounters counters; };
layout(std430, binding = BINDING_RAY_STATES) buffer RayStates { RayState states[]; };
layout(binding = UNIT_MACROCELLS) uniform usampler3D macrocells;
#if BLOCKS
layout(binding = UNIT_SPANS) uniform sampler2D spans;
#endif

const float FAR = 1e30;
const int NOT_SAMPLED = int(0x80000000u);  // no sample's number: shifted ones begin at -1

// One ray of the picture.
struct Ray {
    vec3 direction;                       // unit, local
    float start;                          // distance at which it enters what is shown [world]
    float end;                            // and leaves it
    vec2 seen;                            // distances outside of which all macrocells are empty [world]
    vec3 index_start;                     // sample index at `start`
    vec3 index_direction;                 // sample indices per world unit
    int leap_bit;                         // of the leaps in the texels of the macrocells the first bit of the ray's octant
    vec3 macro_start;                     // in units of macrocells and in this octant, where all ascend: the place at `start`,
    vec3 macro_direction;                 // what is added per world unit,
    vec3 macro_inverse;                   // its inverse, 0 where it runs along none of them,
    vec3 macro_base;                      // `start`, FAR where it does so,
    vec3 macro_texel;                     // and texture coordinates
    float growth;                         // of the steps [world]
    float shift;                          // of the samples, in steps
    vec3 radiance;
    float transmittance;
    int sampled;                          // number of the last sample, or NOT_SAMPLED
    float value;                          // and the field there
    uint samples;
    uint roots;
    uint crossings;
};

// The part of a ray between two samples.
struct Stretch {
    float start;                          // distance [world]
    float end;
    float front;                          // normalised value at `start`
    float back;                           // and at `end`
};

Ray ray;

#include "pass/pixel_ray.glsl"
#include "pass/field.glsl"

vec3 ray_at(float distance) {
    vec3 index = ray.index_start + (distance - ray.start) * ray.index_direction;
    return clamp(index, vec3(0.0), vec3(raycast.samples.xyz - 1));
}

// The field on the ray, for root finding.
float ray_value(float distance) {
    ++ray.roots;
    return field(ray_at(distance));
}

// What light does to a colour there: colour * x + y.
vec2 light_at(float distance) {
#if SHADING
    vec3 slope = field_gradient(ray_at(distance));
    vec3 gradient = slope.x * raycast.index_row_x.xyz + slope.y * raycast.index_row_y.xyz + slope.z * raycast.index_row_z.xyz;
    float steepness = length(gradient);
    vec3 normal = steepness > 0.0 ? gradient / steepness : vec3(0.0);
    float highlight = blinn_phong(vec3(0.0), normal, ray.direction, frame.material).x;
    return vec2(blinn_phong(vec3(1.0), normal, ray.direction, frame.material).x - highlight, highlight);
#else
    return vec2(1.0, 0.0);
#endif
}

// Adds what a part of the ray emits, and takes away what it absorbs.
void composite(vec3 emission, float opacity) {
    ray.radiance += ray.transmittance * emission;
    ray.transmittance *= 1.0 - opacity;
}

#include "pass/transfer.glsl"
#include "pass/classify.glsl"
#include "pass/march.glsl"

void begin_ray(ivec2 pixel) {
    vec3 offset = pixel_offset(pixel);
    vec3 direction = frame.forward + frame.perspective * offset;
    vec3 origin = frame.eye + (1.0 - frame.perspective) * offset;
    ray.direction = normalize(direction);
    vec2 inside = box_of_ray(origin, ray.direction);
    vec2 shown = cut_by_planes(vec2(max(inside.x, 0.0), inside.y), origin, ray.direction);
    ray.start = shown.x;
    ray.end = shown.y;
#if BLOCKS
    vec2 span = texelFetch(spans, pixel / RAY_BLOCK, 0).xy;
    ray.seen = vec2(max(ray.start, span.x), min(ray.end, span.y));
#else
    ray.seen = shown;
#endif
    vec3 entry = origin + ray.start * ray.direction;
    ray.index_start = vec3(dot(raycast.index_row_x.xyz, entry) + raycast.index_row_x.w,
                           dot(raycast.index_row_y.xyz, entry) + raycast.index_row_y.w,
                           dot(raycast.index_row_z.xyz, entry) + raycast.index_row_z.w);
    ray.index_direction = vec3(dot(raycast.index_row_x.xyz, ray.direction), dot(raycast.index_row_y.xyz, ray.direction),
                               dot(raycast.index_row_z.xyz, ray.direction));
    bvec3 across = equal(ray.index_direction, vec3(0.0));
    ivec3 ascends = ivec3(greaterThan(ray.index_direction, vec3(0.0)));
    vec3 towards = vec3(2 * ascends - 1);
    ray.leap_bit = LEAP_BITS * (ascends.x + 2 * ascends.y + 4 * ascends.z);
    ray.macro_start = towards * ray.index_start / float(raycast.macrocells.w);
    ray.macro_direction = towards * ray.index_direction / float(raycast.macrocells.w);
    ray.macro_inverse = mix(1.0 / mix(ray.macro_direction, vec3(1.0), across), vec3(0.0), across);
    ray.macro_base = mix(vec3(ray.start), vec3(FAR), across);
    ray.macro_texel = towards / vec3(raycast.macrocells.xyz);
    ray.growth = frame.perspective * raycast.differential * raycast.step * direction_differential(direction, frame.span_right);
    ray.shift = raycast.jitter_seed == 0u ? 0.0 : pixel_noise(uvec2(pixel), raycast.jitter_seed);
    ray.radiance = vec3(0.0);
    ray.transmittance = 1.0;
    ray.sampled = NOT_SAMPLED;
    ray.samples = 0u;
    ray.roots = 0u;
    ray.crossings = 0u;
}

// Marches a pixel's ray; true, and its colour, if that ends it in this call.
bool raycast_pixel(ivec2 pixel, out vec4 color) {
    ivec2 in_tile = pixel - frame.tile_origin;
    int place = in_tile.y * frame.tile_size.x + in_tile.x;
    color = vec4(0.0);
#if RESUMED
    if (states[place].tile_number != raycast.tile_number) return false;
#endif
    begin_ray(pixel);
    bool ended = true;
    uint counted = 0u;                    // samples of the calls before: one call's sums fit 32 bits, those of a ray may not
    if (ray.start < ray.end && ray.seen.x < ray.seen.y) {
#if RESUMED
        March state = resumed_march(states[place]);
        counted = ray.samples;
#else
        March state = fresh_march();
#endif
        ended = march_on(state);
        if (!ended) states[place] = state_of(state);
    }
    if (ray.samples > counted) atomicAdd(counters.samples, ray.samples - counted);
    if (ray.roots > 0u) atomicAdd(counters.roots, ray.roots);
    if (ray.crossings > 0u) atomicAdd(counters.crossings, ray.crossings);
    if (!ended) {
        atomicAdd(counters.unfinished_rays, 1u);
        return false;
    }
#if RESUMED
    states[place].tile_number = 0u;
#endif
    if (ray.samples > counters.most_samples) atomicMax(counters.most_samples, ray.samples);
    color = vec4(ray.radiance, 1.0 - ray.transmittance) + ray.transmittance * frame.background;
    return true;
}
