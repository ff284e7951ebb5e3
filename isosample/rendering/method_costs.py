"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = \
{'data-centric prepare': {'start': 0.0385, 'scanned_cells': 0.0, 'triangles': 2.943e-07},
 'data-centric frame': {'start': 0.005562,
                        'pixels': 7.943e-08,
                        'triangles': 1.334e-07,
                        'fragments': 4.875e-08,
                        'ordered_fragments': 0.0,
                        'resolved_fragments': 4.084e-08},
 'pre-integrated prepare': {'start': 0.02437, 'voxels': 1.006e-08},
 'pre-integrated frame': {'start': 0.004009,
                          'pixels': 0.0,
                          'samples': 1.978e-08,
                          'pieces': 3.322e-08,
                          'macrocells': 0.0},
 'peak-finding prepare': {'start': 0.02437, 'voxels': 1.006e-08},
 'peak-finding frame': {'start': 0.03254,
                        'pixels': 1.709e-07,
                        'visible_length': 2.301e-07,
                        'samples': 0.0,
                        'pieces': 0.0,
                        'macrocells': 7.918e-08},
 'factors': {'data-centric frame shaded': 1.0,
             'data-centric prepare smooth': 1.89,
             'data-centric frame smooth': 1.0,
             'pre-integrated frame shaded': 4.33,
             'pre-integrated prepare smooth': 3.54,
             'pre-integrated frame smooth': 2.78,
             'peak-finding frame shaded': 4.26,
             'peak-finding prepare smooth': 3.54,
             'peak-finding frame smooth': 3.73}}
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
