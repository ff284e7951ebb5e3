"""Extract once, render many: 8 views around a hydrogen orbital, without touching the volume again."""

import isosample
from isosample.volume.analytic import HydrogenOrbital, sample_field

volume = sample_field(
    HydrogenOrbital(4, 3, 0), (64, 64, 64), lower=(-30, -30, -30), upper=(30, 30, 30), name="4f"
)
tf = isosample.TransferFunction.suggest(volume)
plan = isosample.plan_isovalues(tf, volume.value_range)
with isosample.Renderer(isosample.extract_surfaces(volume, plan.isovalues), plan) as renderer:
    for step in range(8):
        camera = isosample.Camera.orbit(volume.box, azimuth=45 * step, elevation=20)
        renderer.render(camera=camera, size=(400, 400)).save(f"orbit_{step}.png")
