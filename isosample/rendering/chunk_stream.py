"""Where the pieces of a scene come from: arrays in memory, or brick meshes that are loaded one after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.rendering.scene import Scene

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]


class Piece(NamedTuple):
    """One (level, brick) as the GPU takes it.

    Attributes
    ----------
    vertices : (V,) `VERTEX_DTYPE`
    indices : (3T,) uint32
        Rows of `vertices`.
    residuals : (V, 2) float32
        Normalised.
    """

    vertices: npt.NDArray[np.void]
    indices: U32
    residuals: F32


class Source(Protocol):
    """Gives the pieces of a scene."""

    def load(self, chunks: npt.NDArray[np.void]) -> Iterator[Piece]:
        """Yield pieces in the order asked for; (C,) `CHUNK_DTYPE`."""
        ...


class ArraySource:
    """Cuts pieces out of a scene's own arrays.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def load(self, chunks: npt.NDArray[np.void]) -> Iterator[Piece]:
        """Yield pieces in the order asked for; (C,) `CHUNK_DTYPE`."""
        scene = self._scene
        columns = ("first_vertex", "vertex_count", "first_index", "index_count")
        for v, vertex_count, i, index_count in zip(*(chunks[name].tolist() for name in columns), strict=True):
            yield Piece(
                scene.vertices[v : v + vertex_count],
                scene.indices[i : i + index_count] - np.uint32(v),
                scene.residuals[v : v + vertex_count],
            )


def source_of(scene: Scene) -> Source:
    """Where the scene's pieces come from."""
    return ArraySource(scene) if scene.source is None else scene.source
