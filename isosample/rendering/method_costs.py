"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = \
{'data-centric prepare': {'start': 0.04451, 'scanned_cells': 0.0, 'triangles': 4.082e-07},
 'data-centric frame': {'start': 0.008659,
                        'pixels': 5.152e-10,
                        'triangles': 2.686e-08,
                        'fragments': 0.0,
                        'ordered_fragments': 1.086e-08,
                        'resolved_fragments': 0.0},
 'pre-integrated prepare': {'start': 0.02092, 'voxels': 1.263e-08},
 'pre-integrated frame': {'start': 0.005073,
                          'pixels': 0.0,
                          'samples': 1.696e-08,
                          'pieces': 2.793e-08,
                          'macrocells': 2.438e-09},
 'peak-finding prepare': {'start': 0.02092, 'voxels': 1.263e-08},
 'peak-finding frame': {'start': 0.02938,
                        'pixels': 1.402e-07,
                        'visible_length': 2.225e-07,
                        'samples': 0.0,
                        'pieces': 0.0,
                        'macrocells': 6.343e-08},
 'factors': {'data-centric frame shaded': 1.41,
             'data-centric prepare smooth': 11.3,
             'data-centric frame smooth': 1.83,
             'pre-integrated frame shaded': 3.61,
             'pre-integrated prepare smooth': 3.62,
             'pre-integrated frame smooth': 2.28,
             'peak-finding frame shaded': 4.17,
             'peak-finding prepare smooth': 3.62,
             'peak-finding frame smooth': 3.69}}
SOFTWARE_MEASURED = '2026-11-23, llvmpipe (LLVM 15.0.6, 256 bits), AMD EPYC, 2 cores'
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
