"""Names, defaults and file suffixes that the Python interface and the commands share; imports nothing but types."""

from typing import Final

# the methods by name: through isosurfaces; three ways of the ray caster; the field itself in float64
DATA_CENTRIC: Final = "data-centric"
POST_CLASSIFIED: Final = "post-classified"
PRE_INTEGRATED: Final = "pre-integrated"
PEAK_FINDING: Final = "peak-finding"
REFERENCE: Final = "reference"
RAYCAST_METHODS = (POST_CLASSIFIED, PRE_INTEGRATED, PEAK_FINDING)
COMPARED_METHODS = (DATA_CENTRIC, *RAYCAST_METHODS)  # with the reference
CHOSEN_FROM = (DATA_CENTRIC, PRE_INTEGRATED, PEAK_FINDING)  # by the estimate of their costs

DEFAULT_SIZE = (800, 800)  # width, height [pixel]
DEFAULT_MESH_BUDGET_BYTES = 2 << 30  # on the GPU
DEFAULT_PER_SLOPE = 5  # Lindholm et al., section 4
IMAGE_SUFFIXES = (".png", ".npy")
FILM_SUFFIXES = (".mp4", ".gif", *IMAGE_SUFFIXES)
DEFAULT_FRAME_RATE = 20.0  # a whole number of hundredths of a second per frame, as GIF needs it
DEFAULT_REPEAT = 5  # timed frames of a comparison, per setting and camera
MESH_SUFFIXES = (".ply", ".glb", ".stl", ".obj", ".vtp")
VOLUME_SUFFIXES = (".nrrd", ".nii.gz", ".nii", ".mha", ".npy")  # that can be written
DEFAULT_MAX_ISOVALUES = 512  # of a search for a tolerance
DEFAULT_MAX_TRIANGLES = 20_000_000  # a refinement that could have more is not tried
SMALLEST_ERROR = 1e-5  # that may be asked for: slopes are half floats and pictures float32
SHOWN_QUANTILE = 0.999  # errors are told as what all pixels but a thousandth keep to
