"""Where vertices may lie: on multiples of 2⁻¹⁷ voxel, and never at a sample."""

from __future__ import annotations

SMALLEST_FRACTION = 2.0**-14  # a vertex keeps this distance from the samples [voxel]: no zero-area triangle
POSITION_STEPS = 2.0**17  # positions are multiples of 1/POSITION_STEPS [voxel]
LARGEST_BRICK_CELLS = 128  # float32 holds multiples of 2**-17 exactly up to 128
