"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = \
{'data-centric prepare': {'start': 0.03583, 'scanned_cells': 7.849e-10, 'triangles': 2.574e-07},
 'data-centric frame': {'start': 0.005063,
                        'pixels': 7.326e-08,
                        'triangles': 9.125e-08,
                        'fragments': 9.859e-08,
                        'ordered_fragments': 0.0,
                        'resolved_fragments': 0.0},
 'pre-integrated prepare': {'start': 0.0205, 'voxels': 5.455e-09},
 'pre-integrated frame': {'start': 0.006263,
                          'pixels': 0.0,
                          'samples': 2.648e-08,
                          'pieces': 6.703e-08,
                          'macrocells': 2.887e-09},
 'peak-finding prepare': {'start': 0.0205, 'voxels': 5.455e-09},
 'peak-finding frame': {'start': 0.04007,
                        'pixels': 0.0,
                        'visible_length': 2.549e-07,
                        'samples': 0.0,
                        'pieces': 0.0,
                        'macrocells': 1.013e-07},
 'factors': {'data-centric frame shaded': 1.0,
             'data-centric prepare smooth': 1.85,
             'data-centric frame smooth': 1.05,
             'pre-integrated frame shaded': 4.11,
             'pre-integrated prepare smooth': 9.45,
             'pre-integrated frame smooth': 2.08,
             'peak-finding frame shaded': 3.7,
             'peak-finding prepare smooth': 9.45,
             'peak-finding frame smooth': 3.38}}
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
