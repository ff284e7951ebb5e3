"""The pieces of a scene, one per (level, brick): in arrays in memory, or loaded from a store one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.rendering.scene import Scene, ValueScale
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.geometry import GridGeometry

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Records = npt.NDArray[np.void]
U32 = npt.NDArray[np.uint32]

VERTEX_DTYPE = np.dtype([("position", "<f4", 3), ("gradient", "<f4", 3)])
# One (level, brick) at one detail: its triangles in the index buffer, its vertices in the vertex buffer, and
# the box around them relative to the volume's centre [world].
CHUNK_DTYPE = np.dtype(
    [
        ("level", "<u4"),
        ("detail", "<u4"),
        ("brick", "<i4", 3),
        ("first_index", "<i8"),
        ("index_count", "<i8"),
        ("first_vertex", "<i8"),
        ("vertex_count", "<i8"),
        ("low", "<f4", 3),
        ("high", "<f4", 3),
        ("piece", "<i8"),  # place in the source that streams it
    ]
)
ROUNDING = (
    2.0**-22
)  # relative: of boxes that were rounded to float32, in index coordinates and then in the world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelRange:
    """Where one level's triangles stand in the index buffer.

    Attributes
    ----------
    level : int
    first_index, index_count : int
    chunks : (C,) `CHUNK_DTYPE` or None
        The level's pieces, one per detail and brick, one after the other in the index buffer; what is beyond the range
        is cut off. None: the level is one piece, and nothing is known of where it lies.
    """

    level: int
    first_index: int
    index_count: int
    chunks: Records | None = None

    def pieces(self, vertex_count: int) -> Records:
        """(C,) `CHUNK_DTYPE`, what of the level is drawn; of a scene with `vertex_count` vertices."""
        stop = self.first_index + self.index_count
        if self.chunks is None:
            whole = np.zeros(1, dtype=CHUNK_DTYPE)
            whole["first_index"], whole["index_count"] = self.first_index, self.index_count
            whole["vertex_count"], whole["low"], whole["high"] = vertex_count, -np.inf, np.inf
            whole["level"] = self.level
            return whole
        chunks = self.chunks.copy()
        chunks["index_count"] = np.minimum(chunks["index_count"], stop - chunks["first_index"])
        return chunks[chunks["index_count"] > 0]


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

    vertices: Records
    indices: U32
    residuals: F32


class Source(Protocol):
    """Gives the pieces of a scene."""

    def load(self, chunks: Records) -> Iterator[Piece]:
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

    def load(self, chunks: Records) -> Iterator[Piece]:
        """Yield pieces in the order asked for; (C,) `CHUNK_DTYPE`."""
        scene = self._scene
        columns = ("first_vertex", "vertex_count", "first_index", "index_count")
        for v, vertex_count, i, index_count in zip(*(chunks[name].tolist() for name in columns), strict=True):
            yield Piece(
                scene.vertices[v : v + vertex_count],
                scene.indices[i : i + index_count] - np.uint32(v),
                scene.residuals[v : v + vertex_count],
            )


class StoredSource:
    """Loads pieces from a store.

    Parameters
    ----------
    surfaces : StoredSurfaces
    scale : ValueScale
    """

    def __init__(self, surfaces: StoredSurfaces, scale: ValueScale) -> None:
        self._surfaces = surfaces.by_detail
        self._scale = scale

    def load(self, chunks: Records) -> Iterator[Piece]:
        """Yield pieces in the order asked for; (C,) `CHUNK_DTYPE`. Raises `CacheError` if one is damaged."""
        ends = np.flatnonzero(np.diff(chunks["detail"], append=-1)) + 1  # of runs of pieces of one detail
        for part in np.split(chunks, ends[:-1]):
            if len(part) == 0:
                continue
            surfaces = self._surfaces[int(part["detail"][0])]
            for mesh in surfaces.load(part["piece"].tolist()):
                yield Piece(
                    vertex_records(mesh, surfaces.geometry, self._scale),
                    mesh.triangles.ravel().astype(np.uint32),
                    mesh.residuals * np.float32(self._scale.inverse_width),
                )


class SceneArrays(NamedTuple):
    """Vertices, indices and residuals of a scene, and where each level stands in them; see `Scene`."""

    vertices: Records
    indices: U32
    residuals: F32
    levels: tuple[LevelRange, ...]


def merged(surfaces: SurfaceSet, rows: npt.NDArray[np.intp], scale: ValueScale) -> SceneArrays:
    """Arrays of all pieces of some levels, at all details.

    Parameters
    ----------
    surfaces : SurfaceSet
    rows : (K,) int
        Level of the surfaces for every level of the scene.
    scale : ValueScale

    Raises
    ------
    CapacityError
        If there are more vertices than 32-bit indices can name.
    """
    by_isovalue: dict[float, list[tuple[int, BrickMesh]]] = {}
    for detail, part in enumerate(surfaces.by_detail):
        for mesh in (mesh for mesh in part.meshes if len(mesh.triangles)):
            by_isovalue.setdefault(mesh.isovalue, []).append((detail, mesh))
    chosen = [by_isovalue.get(float(surfaces.isovalues[row]), []) for row in rows]
    meshes = [mesh for of_level in chosen for _, mesh in of_level]
    chunks = np.zeros(len(meshes), dtype=CHUNK_DTYPE)
    chunks["level"] = np.repeat(np.arange(len(chosen)), [len(of_level) for of_level in chosen])
    chunks["detail"] = [detail for of_level in chosen for detail, _ in of_level]
    chunks["brick"] = np.array([mesh.brick for mesh in meshes], dtype=np.int32).reshape(-1, 3)
    chunks["piece"] = -1
    _place(chunks, [len(mesh.positions) for mesh in meshes], [mesh.triangles.size for mesh in meshes])
    vertex_count, index_count = (int(chunks[name].sum()) for name in ("vertex_count", "index_count"))
    if vertex_count >= 2**32 or index_count >= 2**31:
        raise CapacityError(
            f"{vertex_count} vertices and {index_count // 3} triangles are more than one draw can name; "
            "use fewer isovalues (--per-slope) or details."
        )
    vertices = np.empty(vertex_count, dtype=VERTEX_DTYPE)
    indices = np.empty(index_count, dtype=np.uint32)
    for row, mesh in enumerate(meshes):
        v, i = int(chunks["first_vertex"][row]), int(chunks["first_index"][row])
        records = vertex_records(mesh, surfaces.geometry, scale)
        chunks["low"][row], chunks["high"][row] = (
            records["position"].min(axis=0),
            records["position"].max(axis=0),
        )
        vertices[v : v + len(records)] = records
        indices[i : i + mesh.triangles.size] = mesh.triangles.ravel().astype(np.uint32) + np.uint32(v)
    residuals = np.concatenate([np.zeros((0, 2), dtype=np.float32), *(mesh.residuals for mesh in meshes)])
    residuals *= np.float32(scale.inverse_width)
    return SceneArrays(vertices, indices, residuals, _ranges(chunks))


def streamed(surfaces: StoredSurfaces, rows: npt.NDArray[np.intp]) -> SceneArrays:
    """Levels of stored surfaces, without arrays; parameters as `merged`."""
    parts = [_stored_pieces(part, rows, detail) for detail, part in enumerate(surfaces.by_detail)]
    chunks = np.concatenate(parts)
    chunks = chunks[np.argsort(chunks["level"], kind="stable")]  # by level, then by detail and brick
    _place(chunks, chunks["vertex_count"].copy(), chunks["index_count"].copy())
    none = np.zeros((0, 2), dtype=np.float32)
    return SceneArrays(np.empty(0, dtype=VERTEX_DTYPE), np.empty(0, dtype=np.uint32), none, _ranges(chunks))


def _stored_pieces(surfaces: StoredSurfaces, rows: npt.NDArray[np.intp], detail: int) -> Records:
    """(C,) `CHUNK_DTYPE`, pieces of some levels of stored surfaces of one detail, with no place in the buffers yet."""
    table = surfaces.chunk_table
    level_of_table = np.full(len(surfaces.isovalues), -1, dtype=np.int64)
    level_of_table[rows] = np.arange(len(rows))
    level = level_of_table[table.level]
    pieces = np.flatnonzero(level >= 0)
    chunks = np.zeros(len(pieces), dtype=CHUNK_DTYPE)
    chunks["level"], chunks["piece"], chunks["detail"] = level[pieces], pieces, detail
    chunks["brick"] = table["brick"][pieces]
    chunks["vertex_count"], chunks["index_count"] = table["vertices"][pieces], 3 * table["triangles"][pieces]
    chunks["low"], chunks["high"] = _local_boxes(
        table["low"][pieces].astype(np.float64), table["high"][pieces].astype(np.float64), surfaces.geometry
    )
    return chunks


def vertex_records(mesh: BrickMesh, geometry: GridGeometry, scale: ValueScale) -> Records:
    """(V,) `VERTEX_DTYPE`, the vertices of one piece as the GPU takes them."""
    records = np.empty(len(mesh.positions), dtype=VERTEX_DTYPE)
    records["position"] = mesh.vertices_world(geometry) - geometry.box.centre
    records["gradient"] = mesh.gradients_world(geometry) * (scale.inverse_width * geometry.box.radius)
    return records


def source_of(scene: Scene) -> Source:
    """Where the scene's pieces come from."""
    return ArraySource(scene) if scene.source is None else scene.source


def _place(chunks: Records, vertex_counts: npt.ArrayLike, index_counts: npt.ArrayLike) -> None:
    """Put the pieces one behind the other."""
    for first, count, sizes in (
        ("first_vertex", "vertex_count", vertex_counts),
        ("first_index", "index_count", index_counts),
    ):
        chunks[count] = sizes
        chunks[first] = np.cumsum(chunks[count]) - chunks[count]


def _ranges(chunks: Records) -> tuple[LevelRange, ...]:
    """The levels that have pieces; `chunks` in their order."""
    levels, first = np.unique(chunks["level"], return_index=True)
    parts = np.split(chunks, first[1:])
    return tuple(
        LevelRange(
            level=level,
            first_index=int(part["first_index"][0]),
            index_count=int(part["index_count"].sum()),
            chunks=part,
        )
        for level, part in zip(levels.tolist(), parts, strict=False)
    )


def _local_boxes(low: F64, high: F64, geometry: GridGeometry) -> tuple[F64, F64]:
    """Boxes along the world's axes, relative to the volume's centre, around boxes in index coordinates.

    Both are float32 numbers, so they are widened by what their rounding may have cut off.
    """
    widened = ROUNDING * (np.maximum(np.abs(low), np.abs(high)) + 1.0)
    matrix = geometry.world_from_index
    middle = 0.5 * (low + high) @ matrix[:3, :3].T + (matrix[:3, 3] - geometry.box.centre)
    half = (0.5 * (high - low) + widened) @ np.abs(matrix[:3, :3]).T
    half += ROUNDING * (np.abs(middle) + half)
    return middle - half, middle + half
