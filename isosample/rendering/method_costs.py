"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = \
{'data-centric prepare': {'start': 0.04319, 'scanned_cells': 0.0, 'triangles': 2.861e-07},
 'data-centric frame': {'start': 0.007439,
                        'pixels': 4.432e-08,
                        'triangles': 1.945e-08,
                        'fragments': 2.342e-08,
                        'ordered_fragments': 9.806e-09,
                        'resolved_fragments': 0.0},
 'pre-integrated prepare': {'start': 0.02125, 'voxels': 1.133e-08},
 'pre-integrated frame': {'start': 0.005419,
                          'pixels': 0.0,
                          'samples': 1.381e-08,
                          'pieces': 3.744e-08,
                          'macrocells': 4.346e-09},
 'peak-finding prepare': {'start': 0.02125, 'voxels': 1.133e-08},
 'peak-finding frame': {'start': 0.0288,
                        'pixels': 1.488e-07,
                        'visible_length': 2.215e-07,
                        'samples': 0.0,
                        'pieces': 0.0,
                        'macrocells': 6.088e-08},
 'factors': {'data-centric frame shaded': 1.16,
             'data-centric prepare smooth': 6.7,
             'data-centric frame smooth': 1.33,
             'pre-integrated frame shaded': 3.22,
             'pre-integrated prepare smooth': 2.78,
             'pre-integrated frame smooth': 2.08,
             'peak-finding frame shaded': 4.2,
             'peak-finding prepare smooth': 2.78,
             'peak-finding frame smooth': 3.75}}
SOFTWARE_MEASURED = '2026-11-22, llvmpipe (LLVM 15.0.6, 256 bits), AMD EPYC, 2 cores'
TOLERANCES: list[dict[str, float]] = [{'tolerance': 0.015625,
  'isovalues': 0.978,
  'triangles': 3.06,
  'step': 1.06,
  'surface_search': 2.05,
  'ray_search': 0.0853},
 {'tolerance': 0.00392156862745098,
  'isovalues': 2.83,
  'triangles': 19.6,
  'step': 0.744,
  'surface_search': 13.5,
  'ray_search': 0.109}]
# fmt: on
