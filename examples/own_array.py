"""Your own array and transfer function: two shells of a torus-like field, cut open and lit."""

import numpy as np

import isosample
from isosample import ClipPlane, ControlPoint, Isosurface, Material, RenderSettings, TransferFunction

z, y, x = np.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
volume = isosample.Volume(np.exp(-8 * ((np.hypot(x, y) - 0.6) ** 2 + z**2)), spacing=(0.1, 0.1, 0.1))
tf = TransferFunction(
    points=[
        ControlPoint(0.3, (0.1, 0.3, 1.0), extinction=0.0),
        ControlPoint(0.5, (0.1, 0.6, 1.0), extinction=1.5),
        ControlPoint(0.7, (0.1, 0.3, 1.0), extinction=0.0),
    ],
    isosurfaces=[Isosurface(0.85, (1.0, 0.5, 0.1), opacity=0.8)],
)
settings = RenderSettings(material=Material(), clip_planes=(ClipPlane(0.0, -1.0, 0.0, 3.15),))
camera = isosample.Camera.orbit(volume.box, azimuth=20, elevation=35)
isosample.render(volume, tf, camera=camera, size=(600, 600), settings=settings).save("torus.png")
