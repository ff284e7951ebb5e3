"""What a unit of work costs each method, by kind of renderer; written by `benchmarks.bench_method_choice --write`."""

from __future__ import annotations

# fmt: off
SOFTWARE: dict[str, dict[str, float]] = {'data-centric prepare': {'start': 0.0114, 'scanned_cells': 1.09e-08, 'triangles': 1.646e-07},
 'data-centric frame': {'start': 0.005767,
                        'pixels': 1.865e-07,
                        'triangles': 7.132e-08,
                        'fragments': 0.0,
                        'ordered_fragments': 0.0,
                        'resolved_fragments': 1.775e-07},
 'pre-integrated prepare': {'start': 0.0, 'voxels': 1.362e-09},
 'pre-integrated frame': {'start': 0.004251,
                          'pixels': 0.0,
                          'samples': 3.531e-08,
                          'pieces': 5.909e-08,
                          'macrocells': 1.224e-08},
 'peak-finding prepare': {'start': 7.615e-05, 'voxels': 5.017e-11},
 'peak-finding frame': {'start': 0.0414,
                        'pixels': 0.0,
                        'visible_length': 2.94e-07,
                        'samples': 0.0,
                        'pieces': 0.0,
                        'macrocells': 1.165e-07},
 'factors': {'data-centric frame shaded': 1.0,
             'data-centric prepare smooth': 5.4,
             'data-centric frame smooth': 1.0,
             'pre-integrated frame shaded': 3.68,
             'pre-integrated prepare smooth': 5.08,
             'pre-integrated frame smooth': 2.0,
             'peak-finding frame shaded': 3.76,
             'peak-finding prepare smooth': 5.08,
             'peak-finding frame smooth': 3.45}}
SOFTWARE_MEASURED = 'provisional: partly assumed, not all measured'
TOLERANCES: list[dict[str, float]] = [{'tolerance': 0.015625,
  'isovalues': 1.1,
  'triangles': 3.4,
  'step': 0.56,
  'surface_search': 40.0,
  'ray_search': 1.0},
 {'tolerance': 0.00392156862745098,
  'isovalues': 3.1,
  'triangles': 46.0,
  'step': 0.28,
  'surface_search': 60.0,
  'ray_search': 1.0}]
# fmt: on
