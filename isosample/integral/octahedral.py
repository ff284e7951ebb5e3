"""Unit vectors in 32 bits: the octahedral map, decoded in float64.

Twin of ``shaders/lib/octahedral.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.integral.checks import last_axis

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

STEPS = 32767  # steps of a signed 16-bit number from 0 to 1 (OpenGL packSnorm2x16)


def octahedral_fold(p: npt.ArrayLike) -> F64:
    """Reflection that exchanges the inner square of the octahedral map (z >= 0) and its corners (z < 0).

    Parameters
    ----------
    p : (..., 2) array_like of float
        Position in the map; an involution where 0 < abs(p) < 1 in both components.

    Returns
    -------
    folded : (..., 2) float64
        (1 − abs(p_y)) sign(p_x), (1 − abs(p_x)) sign(p_y), where sign(0) is 1.

    Raises
    ------
    InputError
        If the last axis is not 2 long.

    References
    ----------
    .. [1] Q. Meyer et al., "On floating-point normal vectors", Computer Graphics Forum 29(4), 2010.
    """
    place = last_axis(p, "p", 2)
    folded: F64 = (1.0 - np.abs(place[..., ::-1])) * np.where(place >= 0.0, 1.0, -1.0)
    return folded


def pack_normal(n: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Unit vectors as two signed 16-bit numbers, x of the octahedral map in the low half.

    Parameters
    ----------
    n : (..., 3) array_like of float
        Direction (x, y, z); its length does not matter. The zero vector is packed as +z.

    Returns
    -------
    bits : (...) uint32
        `unpack_normal` gives the direction back within 6.5e-5 rad.

    Raises
    ------
    InputError
        If the last axis is not 3 long or a component is not finite.

    Notes
    -----
    Rounding moves the point by at most e = 0.5 / 32767 along x and y of the map, so that of the octahedron by
    at most (e, e, −2e), of length √6 e, at 1/√3 or more from the centre: 3√2 e = 6.48e-5 rad.

    References
    ----------
    .. [1] Q. Meyer et al., "On floating-point normal vectors", Computer Graphics Forum 29(4), 2010.
    .. [2] Z. Cigolle et al., "A survey of efficient representations for independent unit vectors",
       JCGT 3(2), 2014.
    """
    vector = last_axis(n, "n", 3)
    if not np.isfinite(vector).all():
        raise InputError("a normal has a component that is not finite; drop such vectors before packing.")
    norm = np.abs(vector).sum(axis=-1, keepdims=True)
    place = np.divide(vector[..., :2], norm, out=np.zeros(vector[..., :2].shape), where=norm > 0.0)
    place = np.where(vector[..., 2:] < 0.0, octahedral_fold(place), place)
    steps = np.rint(np.clip(place, -1.0, 1.0) * STEPS).astype(np.int64) & 0xFFFF
    bits: npt.NDArray[np.uint32] = (steps[..., 0] | (steps[..., 1] << 16)).astype(np.uint32)
    return bits


def unpack_normal(bits: npt.ArrayLike) -> F64:
    """Unit vectors from the bits that `pack_normal` made.

    Parameters
    ----------
    bits : (...) uint32
        x of the octahedral map in the low half, y in the high half.

    Returns
    -------
    n : (..., 3) float64
        Unit vectors (x, y, z).

    Raises
    ------
    InputError
        If the array is not uint32.
    """
    words = np.asarray(bits)
    if words.dtype != np.uint32:
        raise InputError(
            f"packed normals are {words.dtype}; expected uint32. Convert with .astype(numpy.uint32)."
        )
    halves = np.stack([words & np.uint32(0xFFFF), words >> np.uint32(16)], axis=-1).astype(np.uint16)
    place = np.maximum(halves.view(np.int16) / STEPS, -1.0)
    height = 1.0 - np.abs(place).sum(axis=-1, keepdims=True)
    vector = np.concatenate([np.where(height < 0.0, octahedral_fold(place), place), height], axis=-1)
    unit: F64 = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit
