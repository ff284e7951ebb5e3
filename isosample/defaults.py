"""Defaults and file suffixes that the Python interface and the commands share; imports nothing."""

DEFAULT_SIZE = (800, 800)  # width, height [pixel]
DEFAULT_PER_SLOPE = 5  # Lindholm et al., section 4
IMAGE_SUFFIXES = (".png", ".npy")
MESH_SUFFIXES = (".ply", ".glb", ".stl", ".obj", ".vtp")
DEFAULT_MAX_ISOVALUES = 512  # of a search for a tolerance
