"""What one picture cost, and what it did without."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class FrameStatistics:
    """What one picture cost.

    Attributes
    ----------
    fragments : int
        Crossings found in the lists.
    lost_fragments : int
        Rasterised by an independent count but not in the lists: 0, since otherwise there is no picture.
    max_depth_complexity : int
        Longest list.
    band_violations : int
        Rays whose crossings do not add up, by the crossings and ends that do not fit: some were lost, and put in
        between.
    reordered_fragments : int
        Crossings out of the order of the levels on rays whose crossings add up: meshes cut each other there.
    repaired_pixels : int
        Pixels of these rays.
    unrepaired_pixels : int
        Pixels with a lost crossing whose place nothing tells: it was put in by a guess.
    saturated_segments : int
        Segments whose first-order opacity was above 1 and was taken as 1.
    terminated_rays : int
        Rays that ended behind an opaque front.
    tiles : int
        Parts in which the picture was rendered.
    compute_tiles : int
        Of these, those whose triangles compute shaders rasterised; the graphics pipeline did the others'.
    slot_tiles : int
        Of these, those whose lists were in slots; the other lists were linked.
    pool_bytes : int
        Memory of the fragment lists, pool and slots.
    chunks : int
        Pieces of the meshes, (isovalue, brick).
    chunks_coarser : int
        Of these, those that the picture takes at a coarser detail than the finest.
    chunks_outside_view : int
        Pieces that were not drawn because they lie beside the picture (or behind the eye, where that is outside
        of the box).
    chunks_clipped : int
        Pieces that were not drawn because the clip planes leave nothing visible along all rays that meet them.
    triangles_drawn : int
        Of the other pieces.
    mesh_batches : int
        Uploads of meshes for this picture.
    mesh_bytes : int
        Most memory of meshes on the GPU at once.
    projected_bytes : int
        Memory of projected vertices, which compute shaders rasterise, and of the shares of their work groups.
    """

    fragments: int = 0
    lost_fragments: int = 0
    max_depth_complexity: int = 0
    band_violations: int = 0
    reordered_fragments: int = 0
    repaired_pixels: int = 0
    unrepaired_pixels: int = 0
    saturated_segments: int = 0
    terminated_rays: int = 0
    tiles: int = 0
    compute_tiles: int = 0
    slot_tiles: int = 0
    pool_bytes: int = 0
    chunks: int = 0
    chunks_coarser: int = 0
    chunks_outside_view: int = 0
    chunks_clipped: int = 0
    triangles_drawn: int = 0
    mesh_batches: int = 0
    mesh_bytes: int = 0
    projected_bytes: int = 0
