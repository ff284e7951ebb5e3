"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = \
{'data-centric prepare': {'start': 0.01593, 'scanned_cells': 6.232e-09, 'triangles': 1.409e-07},
 'data-centric frame': {'start': 0.003956,
                        'pixels': 1.672e-07,
                        'triangles': 7.908e-08,
                        'fragments': 8.562e-08,
                        'ordered_fragments': 2.105e-08,
                        'resolved_fragments': 0.0},
 'pre-integrated prepare': {'start': 0.008085, 'voxels': 3.193e-09},
 'pre-integrated frame': {'start': 0.004777,
                          'pixels': 5.529e-08,
                          'samples': 3.286e-08,
                          'pieces': 1.019e-07,
                          'macrocells': 1.32e-09},
 'peak-finding prepare': {'start': 0.008085, 'voxels': 3.193e-09},
 'peak-finding frame': {'start': 0.02659,
                        'pixels': 2.194e-07,
                        'visible_length': 3.251e-07,
                        'samples': 0.0,
                        'pieces': 1.694e-09,
                        'macrocells': 7.949e-08},
 'factors': {'data-centric frame shaded': 1.04,
             'data-centric prepare smooth': 4.53,
             'data-centric frame smooth': 1.16,
             'pre-integrated frame shaded': 3.7,
             'pre-integrated prepare smooth': 4.05,
             'pre-integrated frame smooth': 2.13,
             'peak-finding frame shaded': 4.06,
             'peak-finding prepare smooth': 4.05,
             'peak-finding frame smooth': 3.45}}
SOFTWARE_MEASURED = '2026-11-22, llvmpipe (LLVM 15.0.6, 256 bits), AMD EPYC, 2 cores, processor time'
TOLERANCES: list[dict[str, float]] = [{'tolerance': 0.015625,
  'isovalues': 0.978,
  'triangles': 3.06,
  'step': 1.06,
  'surface_search': 3.15,
  'ray_search': 0.0711},
 {'tolerance': 0.00392156862745098,
  'isovalues': 2.83,
  'triangles': 19.6,
  'step': 0.744,
  'surface_search': 14.8,
  'ray_search': 0.0855}]
# fmt: on
