#version 450 core
// Ray caster, fragment entry (faster on software renderers): one pixel's ray through the volume to one colour.

#ifndef RECONSTRUCTION
#error "RECONSTRUCTION: 0 trilinear, 1 four taps along every axis"
#endif
#ifndef FILTERING
#error "FILTERING: 0 in the shader, 1 by the texture unit"
#endif
#ifndef TRANSFER
#error "TRANSFER: 0 straight lines between the points, 1 a texture"
#endif
#ifndef FEW_BANDS
#error "FEW_BANDS: 1 where no bin of the transfer function meets more than two bands, 0 where one may"
#endif
#ifndef SURFACES
#error "SURFACES: 1 where there are isosurfaces, 0 where there are none"
#endif
#ifndef METHOD
#error "METHOD: 0 post-classified, 1 pre-integrated, 2 peak finding"
#endif
#ifndef QUADRATURE
#error "QUADRATURE: 0 the sample at the front, 1 both ends"
#endif
#ifndef INTEGRATION
#error "INTEGRATION: 0 piece by piece, 1 a table for one length, 2 a table for many, 3 integrals over the value"
#endif
#ifndef PEAK_MODE
#error "PEAK_MODE: 0 samples and peaks, 1 peaks in place of samples, 2 peaks alone, 3 samples alone"
#endif
#ifndef PEAK_WEIGHT
#error "PEAK_WEIGHT: 0 extinction over a length of 1, 1 share of the integral"
#endif
#ifndef CROSSINGS
#error "CROSSINGS: 0 rule of signs and secant steps, 1 roots of every cell's cubic"
#endif
#ifndef PEAKS
#error "PEAKS: most peaks of an entry of the peak table, 1 to 4"
#endif
#ifndef ADAPTIVE
#error "ADAPTIVE: 1 steps of a multiple that the macrocell tells, 0 of one sample"
#endif
#ifndef RESUMED
#error "RESUMED: 1 goes on with rays from their states, 0 begins them"
#endif
#ifndef BLOCKS
#error "BLOCKS: 1 where the spans of blocks of pixels are known, 0 where all of a ray is marched"
#endif
#ifndef SHADING
#error "SHADING: 1 lights the colours, 0 does not"
#endif

#include "lib/layouts.glsl"
#include "lib/ray.glsl"
#include "lib/sampling.glsl"
#include "lib/optics.glsl"
#include "lib/bands.glsl"
#include "lib/shading.glsl"
#include "pass/raycast.glsl"

out vec4 color;

void main() {
    if (gl_HelperInvocation || !raycast_pixel(ivec2(gl_FragCoord.xy), color)) discard;
}
