"""The shortest way to a picture: a volume file, and a transfer function suggested from its histogram.

python examples/first_picture.py VOLUME  writes picture.png
"""

import sys

import isosample

if len(sys.argv) != 2:
    sys.exit(__doc__)
volume = isosample.open_volume(sys.argv[1])
image = isosample.render(volume, camera=isosample.Camera.orbit(volume.box, azimuth=30, elevation=20))
image.save("picture.png")
