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
DEFAULT_SCREEN_ERROR = 0.25  # of coarser meshes [pixel]
SMALLEST_ERROR = 1e-5  # that may be asked for: slopes are half floats and pictures float32
SHOWN_QUANTILE = 0.999  # errors are told as what all pixels but a thousandth keep to
AUTO_DISTANCE = 0.01  # rms distance between mesh and isosurface that an automatic refinement asks for [voxel]
MAX_CLIP_PLANES = 8  # shaders/lib/layouts.glsl has the same; the frame checks that they agree
LARGEST_GIF_RATE = 50.0  # viewers play shorter delays than 1/50 s at a slow rate of their own

# the ray caster
DEFAULT_STEP = 0.5  # [voxel]
DEFAULT_PIXEL_SCALE = 4.0  # s_k of Knoll et al. 2009, section 5.3
MACROCELLS = 64  # along the longest axis
DEFAULT_TABLE_SIZE, TABLE_SIZE_RANGE = 256, (2, 1024)  # of pre-integration, along an edge
DEFAULT_PEAK_BINS, PEAK_BIN_RANGE = 256, (16, 1024)  # of the peak table, along an edge
DEFAULT_PEAKS, MOST_PEAKS = 1, 4  # of an entry of that table
DEFAULT_ROOT_ITERATIONS = 3  # secant steps
EXACT_PEAKS: Final = {"peak_weight": "integral", "crossings": "exact"}  # the peak finding that `auto` means

# a comparison, from coarse to fine
DEFAULT_STEPS = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)  # [voxel]
DEFAULT_PIXEL_SCALES = (16.0, 8.0, 4.0, 2.0, 1.0)
DEFAULT_PER_SLOPES = (1, 2, 3, 5, 9, 17)
DEFAULT_TOLERANCES = (1 / 64, 1 / 255)

# anisotropic diffusion
DEFAULT_CONDUCTANCE = 1.0
DEFAULT_ITERATIONS = 5
DEFAULT_TIME_SHARE = 0.375  # of the longest stable step: 1/16 for a spacing of 1, what ITK recommends
