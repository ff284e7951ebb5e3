"""What is known of every piece of some isosurfaces without loading it: its size, its place, its error."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.surfaces.mesh_error import MeshError, combined

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from isosample.surfaces.mesh import BrickMesh
    from isosample.volume.grid import F64

CHUNK_ROW = np.dtype(
    [
        ("isovalue", "<f8"),
        ("row", "<i8"),  # of the brick in `bricks_of`
        ("brick", "<i4", 3),
        ("triangles", "<i8"),
        ("vertices", "<i8"),
        ("low", "<f4", 3),  # box around the vertices, index coordinates (x, y, z) of the volume [voxel]
        ("high", "<f4", 3),
        ("bytes", "<i8"),  # of the arrays in memory
        ("errors", "<f8", len(fields(MeshError))),  # NaN where the extraction was not asked for residuals
        ("key", "S64"),
    ]
)
Rows = npt.NDArray[np.void]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChunkTable:
    """Pieces of isosurfaces, ordered by (isovalue, brick).

    Attributes
    ----------
    isovalues : (K,) float64
        Ascending; a surface may have no piece.
    rows : (N,) `CHUNK_ROW`
        One per piece that has triangles.
    """

    isovalues: F64
    rows: Rows

    @classmethod
    def of(cls, isovalues: F64, rows: Iterable[Rows]) -> ChunkTable:
        """Sort rows that come in any order."""
        plain = [
            np.ascontiguousarray(part).view(np.uint8) for part in rows
        ]  # numpy joins rows field by field
        joined = np.concatenate([np.empty(0, dtype=np.uint8), *plain]).view(CHUNK_ROW)
        order = np.lexsort((joined["row"], joined["isovalue"]))
        return cls(isovalues=isovalues, rows=joined[order])

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def level(self) -> npt.NDArray[np.int64]:
        """(N,) int64, place of each piece's isovalue in the list of isovalues."""
        return np.searchsorted(self.isovalues, self.rows["isovalue"]).astype(np.int64)

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """(N, …) a column: level, brick, triangles, vertices, low, high, bytes, …."""
        found: npt.NDArray[Any] = self.level if column == "level" else self.rows[column]
        return found

    def per_level(self, column: str) -> tuple[int, ...]:
        """Sum of a column over the pieces of every level."""
        totals = np.zeros(len(self.isovalues), dtype=np.int64)
        np.add.at(totals, self.level, self.rows[column])
        return tuple(totals.tolist())

    def select(
        self, levels: Sequence[int] | None = None, bricks: Sequence[tuple[int, int, int]] | None = None
    ) -> npt.NDArray[np.intp]:
        """Places in the table of the pieces of some levels in some bricks; None: of all."""
        chosen = np.ones(len(self.rows), dtype=np.bool_)
        if levels is not None:
            chosen &= np.isin(self.level, np.asarray(levels, dtype=np.int64))
        if bricks is not None:
            wanted = {tuple(brick) for brick in bricks}
            chosen &= np.array(
                [tuple(brick) in wanted for brick in self.rows["brick"].tolist()], dtype=np.bool_
            )
        return np.flatnonzero(chosen)

    def mesh_error(self, level: int) -> MeshError:
        """Distance of one level's triangles from its isosurface."""
        names = [field.name for field in fields(MeshError)]
        figures = self.rows["errors"][self.level == level].tolist()
        return combined([MeshError(**dict(zip(names, row, strict=True))) for row in figures])


def chunk_row(mesh: BrickMesh, brick_row: int, key: str) -> Rows:
    """(1,) `CHUNK_ROW` of a piece, or (0,) of one without triangles."""
    if not len(mesh.triangles):
        return np.empty(0, dtype=CHUNK_ROW)
    row = np.zeros(1, dtype=CHUNK_ROW)
    row["isovalue"], row["row"], row["brick"], row["key"] = mesh.isovalue, brick_row, mesh.brick, key
    row["triangles"], row["vertices"] = len(mesh.triangles), len(mesh.positions)
    row["low"] = mesh.positions.min(axis=0) + np.array(mesh.start)
    row["high"] = mesh.positions.max(axis=0) + np.array(mesh.start)
    row["bytes"] = sum(
        array.nbytes
        for array in (mesh.positions, mesh.gradients, mesh.edge_keys, mesh.triangles, mesh.residuals)
    )
    row["errors"] = np.nan if mesh.error is None else astuple(mesh.error)
    return row
