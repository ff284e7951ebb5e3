"""The shortest way to a picture: a volume file, and a transfer function suggested from its histogram."""

import sys

import isosample

volume = isosample.open_volume(sys.argv[1])
image = isosample.render(volume, camera=isosample.Camera.orbit(volume.box, azimuth=30, elevation=20))
image.save("picture.png")
