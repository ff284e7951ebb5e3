"""Many chunks of a batch from their contents: compiled, in one call that never asks for the interpreter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.compiled import compiled
from isosample.surfaces.chunk_layout import ABSENT, ERROR_COUNT, PACKED
from isosample.surfaces.decoding_kernels import (
    restore_corners,
    restore_floats,
    restore_gradients,
    restore_residuals,
    restore_triangles,
    restore_vertices,
)

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from isosample.surfaces.mesh import F32, I32, I64
    from isosample.volume.grid import F64

    Header = Any  # a row of `HEADER_ROW`
    Headers = npt.NDArray[np.void]
    U8 = npt.NDArray[np.uint8]

WHOLE, WRONG_LENGTH, WRONG_VERTICES, WRONG_GRADIENTS, WRONG_TRIANGLES = 0, 1, 2, 3, 4  # what is wrong


@compiled
def restore_chunks(
    contents: U8,
    headers: Headers,
    powers: F64,
    triples: U8,
    room: I32,
    positions: F32,
    gradients: F32,
    keys: I64,
    residuals: F32,
    triangles: I32,
    faults: U8,
) -> None:
    """Restore chunks whose contents and arrays stand one after the other.

    Parameters
    ----------
    contents : (N,) uint8
    headers : (C,) `HEADER_ROW`
        Of the chunks, in their order.
    powers : float64
        2^(exponent - 15) from the exponent -`LOWEST_EXPONENT` on.
    triples : (13³, 3) uint8
        Edge numbers of the corners of each triple.
    room : int32
        Four times the samples of the largest brick, of any content.
    positions, gradients, keys, residuals, triangles
        Out; (V, 3), (V, 3), (V,), (R, 2), (T, 3): residuals only of the chunks that have some.
    faults : (C,) uint8
        Out: what is wrong with each chunk, `WHOLE` if nothing is.
    """
    at = vertex = residual = triangle = 0
    for n in range(len(headers)):
        header = headers[n]
        vertices = vertex + int(header.vertex_count)
        measured = residual + (0 if header.residuals == ABSENT else int(header.vertex_count))
        ends = triangle + int(header.triangle_count), at + int(header.content_bytes)
        faults[n] = restore_chunk(
            contents[at : ends[1]],
            header,
            powers,
            triples,
            room,
            positions[vertex:vertices],
            gradients[vertex:vertices],
            keys[vertex:vertices],
            residuals[residual:measured],
            triangles[triangle : ends[0]],
        )
        vertex, residual, triangle, at = vertices, measured, ends[0], ends[1]


@compiled
def restore_chunk(
    content: U8,
    header: Header,
    powers: F64,
    triples: U8,
    room: I32,
    positions: F32,
    gradients: F32,
    keys: I64,
    residuals: F32,
    triangles: I32,
) -> int:
    """Restore one chunk; return what is wrong with it. Sections follow each other as `encode` writes them."""
    vertices, faces = len(positions), len(triangles)
    fraction_at = vertices * int(header.slot_width) + 4 * int(header.slot_escapes)
    exponent_at = fraction_at + 3 * int(header.fraction_count)
    exact = header.gradients == PACKED
    mantissa_at = exponent_at
    if exact:
        mantissa_at += vertices * int(header.exponent_width) + 4 * int(header.exponent_escapes)
    residual_at = mantissa_at + (6 if exact else 12) * vertices
    key_at = residual_at + (4 if header.residuals == PACKED else 8) * len(residuals)
    step_at = key_at + 8 * int(header.key_count)
    in_cells = header.triangles == PACKED
    steps = (1 if in_cells else 3) * faces
    code_at = step_at + steps * int(header.step_width) + 4 * int(header.step_escapes)
    end = code_at + (2 * faces if in_cells else 0) + (8 * ERROR_COUNT if header.has_error else 0)
    if end != len(content):
        return WRONG_LENGTH
    if not restore_vertices(content, header, 0, fraction_at, key_at, room, positions, keys):
        return WRONG_VERTICES
    if not exact:
        restore_floats(content, exponent_at, gradients)
    elif not restore_gradients(
        content, exponent_at, int(header.exponent_width), mantissa_at, powers, gradients
    ):
        return WRONG_GRADIENTS
    restore_residuals(content, residual_at, header.residuals == PACKED, residuals)
    if in_cells:
        whole = restore_triangles(content, header, step_at, code_at, triples, room, triangles)
    else:
        whole = restore_corners(content, step_at, int(header.step_width), vertices, triangles)
    return WHOLE if whole else WRONG_TRIANGLES
