// Every struct, constant and binding that shaders and host share. Parsed by isosample/gl/layouts.py: plain GLSL,
// one declaration per line, no preprocessor.
//
// Spaces: "local" is world minus the centre of the volume's box (world units, small numbers in float32);
// "unit" is the box's own frame, [0, 1] along each edge. Values are normalised: (v - low) / (high - low) of the
// volume's range, so that a large offset in the data costs no accuracy.

const int BINDING_FRAME = 0;             // uniform block
const int BINDING_HEADS = 0;             // storage: one list head per pixel of the tile
const int BINDING_COUNTERS = 2;          // storage: struct Counters
const int BINDING_SHARES = 3;            // storage, of the build pass by compute shaders: struct Share, one per work group
const int BINDING_SLOT_STORE = 4;        // storage: the same buffer as BINDING_SLOTS, to be written
const int BINDING_NODE_STORE = 6;        // storage: the same buffer as BINDING_NODES, to be written
const int BINDING_BOUNDARY = 5;          // storage: six faces of normalised samples, or of spline coefficients
const int BINDING_RAYCAST = 1;           // uniform block of the ray caster: struct Raycast
const int BINDING_RAY_COUNTERS = 6;      // storage: struct RayCounters
const int BINDING_RAY_STATES = 7;        // storage: struct RayState, one per pixel of the tile
const int BINDING_IMAGE = 0;             // image unit: the resolved picture, premultiplied linear RGBA
const int BINDING_NODES = 1;             // image unit: the fragment pool, one texel per struct Node
const int BINDING_VERTICES = 7;          // storage, of the build pass by compute shaders: position and gradient of every vertex
const int BINDING_INDICES = 7;           // storage, of the same but not in one program with them: three vertices per triangle
const int BINDING_RESIDUALS = 1;         // storage, of the same: how far the field is from the isovalue near every vertex
const int BINDING_PLACES = 2;            // image unit, of the same: where the vertices are in the picture [pixel], VERTEX_ROW in a row
const int BINDING_CORNERS = 3;           // image unit, of the same: gradients and depths of the vertices
const int BINDING_POSITIONS = 4;         // image unit, of the same: positions and moments of the vertices
const int BINDING_SLOTS = 5;             // image unit: crossings in the slots of pixels, see pass/slots.glsl
const int BINDING_SLOT_NORMALS = 6;      // image unit: their packed normals, of lit pictures
const int BINDING_TABLE = 7;             // image unit: struct Band and struct Level as texels, see pass/tables.glsl
const int BINDING_PACKETS = 1;           // storage: packets of pixels by the length of their lists, see group_packets.comp
const int UNIT_VOLUME = 0;               // texture unit: normalised samples, or spline coefficients
const int UNIT_MACROCELLS = 1;           // texture unit: of an empty macrocell the leaps in eight octants, else the step multiplier, see below
const int UNIT_TRANSFER = 2;             // texture unit: the transfer function, see the texels below
const int UNIT_PRE_INTEGRATION = 3;      // texture unit: radiance and opacity of a stretch by its two values (and length)
const int UNIT_PEAK_TABLE = 4;           // texture unit: peaks between two values
const int UNIT_SPANS = 5;                // texture unit: distances between which the rays of a block of pixels may see something

const int BAND_START_COUNT = 1024;       // bins of the normalised value range
const int SAMPLED_ROWS = 8;              // of the sampled transfer function: 8192 entries, as Knoll et al. 2009 have it
const int INTEGRAL_ROWS = 24;            // of the integrals of the transfer function over the value: three texels for each of 8192 cells
const int BAND_TEXELS = 8;               // of a band, and of a peak, in the texture of the transfer function:
const int TEXEL_OPTICS_LOW = 0;          // straight linear RGB and extinction at the lower end of the band
const int TEXEL_OPTICS_HIGH = 1;         // and at the upper one
const int TEXEL_RANGE = 2;               // values at the two ends, largest extinction, inverse width
const int TEXEL_IMPULSE = 3;             // of the level at the upper end: straight linear RGB, opacity of an isosurface
const int TEXEL_SHEET = 4;               // the same of a peak
const int TEXEL_PEAK = 5;                // of the peak of this number: straight linear RGB, opacity
const int TEXEL_PEAK_PLACE = 6;          // its value; 1 for an isosurface
const uint NO_PEAK = 0xFFFFu;            // behind the last peak of an entry of the peak table

const float MASKED_VALUE = 1e20;         // a sample above this is not finite in the data: nothing is seen there

const uint LIST_END = 0xFFFFFFFFu;       // ends a fragment list
const uint LIST_DONE = 0xFFFFFFFEu;      // in place of a list whose pixel is resolved
const uint BROKEN_LIST = 0x80000000u;    // on the head of a list that is no chain, see pass/chain.glsl
const int LEAP_BITS = 4;                 // of a leap, in a texel of the macrocells: eight of them, by the octant's number (1 where x ascends,
                                         // 2 where y, 4 where z); where the first is 0 something is seen, and behind it is the multiplier
const uint LEAP_MASK = 15u;              // the first leap
const int RAY_BLOCK = 8;                 // edge of the blocks of pixels whose rays leap over empty macrocells together [pixel]
const int RESOLVE_BLOCK = 4;             // edge of the blocks of open_blocks.vert [pixel]: what llvmpipe shades at once
const int TABLE_ROW = 1024;              // bands in a row of their image
const int TABLE_TEXELS = 5;              // of a band and the level at its upper end
const uint SLOT_GROUP = 16u;             // a pixel has so many slots, or a multiple
const uint PACKET_CLASSES = 12u;         // of packets, by their longest list, see class_of in pass/packets.glsl
const int PACKET_WIDTH = 4;              // pixels of a packet to the right,
const int PACKET_HEIGHT = 2;             // and up: what llvmpipe shades at once
const uint PACKET_PIXELS = 8u;           // in all
const uint VERTEX_ROW = 4096u;           // vertices in a row of the images of the build pass by compute shaders
const int LARGEST_TRIANGLE = 120;        // edge of the largest box around a triangle that these rasterise [pixel]: edge functions reach
                                         // 2 (121 · 256)² in it and a pixel beside it, which fits 32 bits, and the loops of 8 triangles that
                                         // llvmpipe runs at once, 2 · 121² + 8 · 122 turns at most, end before its 65535
const float NOT_IN_PICTURE = 1e30;       // in place of the x of a vertex that cannot be projected; y: 1 behind the eye, 0 too far aside
const uint LEVEL_MASK = 0x7FFFu;         // low 15 bits of Node.surface: level index
const uint RISING_BIT = 0x8000u;         // bit 15 of Node.surface: the value rises along the ray
const int MAX_LEVELS = 32767;            // levels that fit LEVEL_MASK, the mask marker excluded
const uint DOMAIN_LEVEL = 0x7FFFu;       // Node.surface level of a fragment on the border of the valid cells
const uint NO_NORMAL = 0x80008000u;      // where the gradient is zero, and at the ends of the box; no vector is packed as this
const float LARGEST_HALF = 65504.0;      // of the slopes in the nodes: steeper is as steep
const float LEAST_SHEET_SLOPE = 1e-6;    // |df/dt| times the box radius: a sheet is met no more slowly than that
const int MAX_CLIP_PLANES = 8;
const uint LINK_SORT_LIMIT = 1024u;      // longer lists are sorted by merge_lists.comp, one call per pass: llvmpipe ends
                                         // every loop of a shader call after 65535 iterations in all, in silence

// One crossing of a ray with an isosurface: 16 bytes.
struct Node {
    uint next_index;                     // next node of this pixel's list, or LIST_END
    float distance;                      // along the unit ray direction, from the ray's origin [world]
    uint surface;                        // level, rising bit, and |df/dt| times the box radius as a half float (high 16 bits)
    uint normal;                         // octahedral unit normal, 2 x 16 bits, or NO_NORMAL; on DOMAIN_LEVEL the value's float bits
                                         // (and its tolerance in place of the slope)
};

struct Counters {
    uint node_count;                     // nodes asked for by the build pass
    uint walked_count;                   // nodes found in the lists by the resolve pass
    uint max_depth_complexity;           // longest list
    uint band_violations;                // fragments that do not continue the walk of a ray that is not balanced
    uint reordered_fragments;            // fragments of balanced rays that do not stand in the order of the levels
    uint repaired_pixels;                // rays with such fragments
    uint unrepaired_pixels;              // rays with a lost crossing whose place nothing tells
    uint unfinished_rays;                // walks that the driver ended before their list did: 0, or there is no picture
    uint saturated_segments;             // segments whose first-order opacity was above 1 (--segment constant, first order)
    uint terminated_rays;                // rays cut short behind an opaque front
    uint longer_lists;                   // lists left to a later program of the resolve pass because of their length,
    uint broken_chains;                  // and because they are no chains;
    uint balanced_lists;                 // of these resolved, as their crossings add up
    uint rasterised;                     // by compute shaders: fragments, counted triangle by triangle
    uint broken_nodes;                   // crossings of the lists that are no chains, where they are in slots,
    uint spilled;                        // and how many of these were put into linked lists
    uint unsuited;                       // triangles that these cannot rasterise: then there is no list at all
};

// The TF inside one band; linear in the value between the two ends (one-sided limits).
struct Band {
    vec4 low;                            // straight linear RGB and extinction [1/world] at the lower end
    vec4 high;                           // the same at the upper end
    float value_low;                     // normalised
    float value_high;                    // normalised
    float extinction_max;                // larger of the two ends [1/world]; 0: nothing to see in this band
    float inverse_width;                 // 1 / (value_high - value_low), or 0 for an empty band
};

// What a ray meets at an isovalue itself.
struct Level {
    vec4 impulse;                        // straight linear RGB and opacity of one crossing
    vec4 sheet;                          // straight linear RGB and area of a thin peak: its extinction times normalised value
};

// What a work group of the build pass by compute shaders takes of the meshes.
struct Share {
    uint first;                          // triangle, or vertex
    uint count;                          // how many, 64 at most
    uint level;                          // of triangles
};

// Camera, box and settings of one frame (std140).
struct Frame {
    vec3 eye;            float perspective;        // local [world]; 1 perspective, 0 orthographic
    vec3 forward;        float box_radius;         // unit view direction; bounding sphere of the box [world]
    vec3 span_right;     float inverse_span_right; // half-extent of the image at distance 1 (perspective) or of the window
    vec3 span_up;        float inverse_span_up;    // the same upwards; the inverses divide by the squared length once more
    vec4 unit_row_x;     // unit = (dot(row.xyz, local) + row.w)
    vec4 unit_row_y;
    vec4 unit_row_z;
    vec4 first_sample;   // local position of sample (0, 0, 0)
    vec4 step_x;         // from one sample to the next along each index axis [world]
    vec4 step_y;
    vec4 step_z;
    vec4 background;     // premultiplied linear RGBA
    vec4 material;       // ambient, diffuse, specular, shininess
    vec4 face_kernel[4];                 // of smooth faces: weight of each of 4 taps, a cubic of the fraction
    vec4 clip_planes[MAX_CLIP_PLANES];   // keep where dot(plane.xyz, local) + plane.w >= 0
    ivec2 image_size;    // pixels
    ivec2 tile_origin;   // first pixel of the tile, x to the right and y up
    ivec2 tile_size;
    int clip_plane_count;
    uint node_capacity;
    ivec2 samples_xy;    // samples of the volume along x and y
    int samples_z;
    int level_count;
    float min_transmittance; // a ray stops below this
    uint longest_walked;     // longer lists are not resolved: merge_lists.comp has not sorted them yet
    int box_faces;           // 1: rays enter and leave through the box; 0: through domain fragments in the lists
    float curved_limit;      // largest way from a triangle to the curved surface [world]
    float reach;             // diagonal of a cell [world]: how far apart crossings of one place may lie in the wrong order
};

// Volume and sampling of the ray caster (std140).
struct Raycast {
    vec4 index_row_x;    // sample index = dot(row.xyz, local) + row.w
    vec4 index_row_y;
    vec4 index_row_z;
    ivec3 samples;       // along x, y, z
    int band_count;
    ivec4 macrocells;    // macrocells along x, y, z; w: cells along an edge of one
    vec4 kernel[4];      // smooth reconstructions: weight of each of 4 taps, a cubic of the fraction
    vec4 lowest;         // premultiplied colour and extinction at the volume's lowest value [1/world]
    float step;          // first step along a ray [world]
    float differential;  // 1: steps grow with the distance from the eye; 0: they do not
    int root_iterations; // secant steps
    uint jitter_seed;    // 0: no jitter
    int table_layers;    // lengths of the pre-integration table
    float table_length;  // stretch of its first layer [world]
    float table_ratio;   // natural logarithm of the length of one layer over that of the one before
    int loop_limit;      // iterations after which a ray is put aside until the next call
    uint tile_number;    // from 1 on, of all pictures: tells the states of this tile's rays from what is left of others
};

// Where a ray is, between two calls.
struct RayState {
    vec4 light;          // radiance, transmittance
    int sample_index;    // next sample
    float entry;         // distance at which the macrocell was entered [world]
    uint samples;        // so far
    uint tile_number;    // of the tile whose ray goes on from here; 0: none does
};

// What one call counted, over all rays of a tile.
struct RayCounters {
    uint samples;        // field evaluations of the sampling, gradients not counted
    uint roots;          // field evaluations of root finding
    uint macrocells;     // visited with samples
    uint skipped;        // leaps over empty macrocells
    uint terminated_rays; // ended behind an opaque front
    uint unfinished_rays; // have to go on in another call
    uint most_samples;   // of one ray that has ended, in all its calls
    uint crossings;      // of peaks and isosurfaces, composited
};
