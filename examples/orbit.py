"""Extract once, render many: a turn around a hydrogen orbital, without touching the volume again."""

import isosample
from isosample.volume.analytic import HydrogenOrbital, sample_field

volume = sample_field(
    HydrogenOrbital(4, 3, 0), (64, 64, 64), lower=(-30, -30, -30), upper=(30, 30, 30), name="4f"
)
tf = isosample.TransferFunction.suggest(volume)
plan = isosample.plan_isovalues(tf, volume.value_range)
cameras = [isosample.Camera.orbit(volume.box, azimuth=45 * step, elevation=20) for step in range(8)]
with (
    isosample.Renderer(isosample.extract_surfaces(volume, plan.isovalues), plan) as renderer,
    isosample.Film("orbit.gif", (400, 400), len(cameras), frame_rate=4) as film,
):
    for camera in cameras:
        film.add(renderer.render(camera=camera, size=(400, 400)))
